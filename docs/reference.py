"""Writes the generated pages: docs/cli.md, docs/python_reference.md, docs/gallery.md: `python docs/reference.py`."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator
from pathlib import Path

import rso
from rso.cli.arguments import Parser, parser

ROOT = Path(__file__).parents[1]
MADE = "<!-- made by `python docs/reference.py` -->"


def cli() -> str:
    """Every command with its arguments."""
    whole = parser(["new"])
    lines = [MADE, "# Command line", "", whole.description or "", "", "```text", (whole.epilog or "").strip(), "```"]
    for name, command in _commands(whole).items():
        lines += ["", f"## rso {name}", "", _sentence(command.description or ""), ""]
        lines += ["| argument | meaning |", "|---|---|"]
        lines += [f"| {_words(a)} | {_sentence(_help(a))} |" for a in command._actions if a.dest != "help"]
    return "\n".join(lines) + "\n"


def _commands(whole: Parser) -> dict[str, Parser]:
    return next(a.choices for a in whole._actions if isinstance(a.choices, dict))


def _words(action: object) -> str:
    names = ", ".join(f"`{o}`" for o in action.option_strings)
    if names:
        meta = action.metavar or (action.dest.upper() if action.nargs != 0 else "")
        meta = " ".join(meta) if isinstance(meta, tuple) else meta
        return f"{names} {meta}".strip().replace("|", "\\|")
    return f"`{action.metavar or action.dest}`"


def _help(action: object) -> str:
    choices = f"one of {', '.join(map(str, action.choices))}" if action.choices else ""
    return "; ".join(filter(None, [action.help, choices])).replace("%%", "%").replace("|", "\\|")


def _sentence(text: str) -> str:
    text = " ".join(text.split())
    return text[:1].upper() + text[1:] + ("." if text and text[-1] not in ".!?" else "")


def python_reference() -> str:
    """Every public name of `rso` with its signature and docstring."""
    lines = [MADE, "# Python functions", "", "What `import rso` offers; [From Python](python.md) shows it in use."]
    for name in sorted(rso.__all__, key=str.lower):
        value = getattr(rso, name)
        lines += ["", f"## rso.{name}", "", "```python", _signature(name, value), "```", ""]
        lines += [_markdown(inspect.getdoc(value) or "")]
        for member, inner in _members(value):
            lines += ["", f"### {name}.{member}", "", "```python", _signature(member, inner), "```", ""]
            lines += [_markdown(inspect.getdoc(inner) or "")]
    return "\n".join(lines) + "\n"


def _members(value: object) -> Iterator[tuple[str, object]]:
    if inspect.isclass(value) and not issubclass(value, BaseException):
        for name, inner in sorted(vars(value).items()):
            if not name.startswith("_") and (inspect.isfunction(inner) or isinstance(inner, property)):
                if inspect.getdoc(inner):
                    yield name, inner


def _signature(name: str, value: object) -> str:
    if isinstance(value, property):
        return name
    try:
        return f"{name}{inspect.signature(value)}"
    except (TypeError, ValueError):
        return name


def _markdown(text: str) -> str:
    """Docstrings as Markdown: roles and double backquotes are code."""
    text = re.sub(r":\w+:`[.~]*([^`]*)`", r"`\1`", text)
    return text.replace("``", "`")


def gallery() -> str:
    """Every worked study: title, picture, problem."""
    lines = [MADE, "# Gallery", "", "Worked studies; each page says problem, data, command and result."]
    for page in sorted((ROOT / "studies").glob("*/README.md")):
        text, name = page.read_text(encoding="utf-8"), page.parent.name
        title = text.split("\n")[0].removeprefix("# ")
        problem = re.search(r"\*+Problem\.\*+ (.*?)\n\n", text, re.DOTALL)
        words = problem[1] if problem else text.split("\n\n")[1]
        words = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", " ".join(words.split()))
        first = re.split(r"(?<=[.!?])[”\"]*\s(?=[A-Z“\"])", words)[:2]
        lines += ["", f"## [{title}](../studies/{name}/README.md)", ""]
        picture = next((p for p in ("sketch.svg", "kidney.png") if (page.parent / p).is_file()), None)
        lines += [f"![{title}](../studies/{name}/{picture})", ""] if picture else []
        lines += [" ".join(first)]
    return "\n".join(lines) + "\n"


PAGES = {"cli.md": cli, "python_reference.md": python_reference, "gallery.md": gallery}

if __name__ == "__main__":
    for name, page in PAGES.items():
        (ROOT / "docs" / name).write_text(page(), encoding="utf-8")
