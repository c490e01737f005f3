"""Templates of one language: `"The {name} is {value}." = "{name}: {value}."`, one file a topic.

A slot takes what stands in its place.  `{name}` keeps it, with numbers as the language writes them; `{name!}` is a
phrase that has a template of its own.  A slot whose name begins with `n_` takes a number only, one that begins with
`w_` takes one word.  The template with the most letters of its own is tried first.
"""

from __future__ import annotations

import functools
import re
import tomllib
from dataclasses import dataclass, field
from pathlib import Path

_LANGUAGES_FOLDER = Path(__file__).parent
_TEMPLATE_SLOT = re.compile(r"\{(\w+)(!?)\}")
_SENTENCE_GAP = re.compile(r"(?<=[.!?])(?<!e\.g\.)(?<!i\.e\.)(?<!vs\.)(?<!eq\.)\s+(?=[^a-z\s)\].,;]|p = )")
_DECIMAL_NUMBER = re.compile(r"(?<![\w.])(\d+)\.(\d+)(?![\w]|\.\d)")
_WORDLESS_TEXT = re.compile(r"[^A-Za-z]*$")
_UNIT_PART = r"(?:[kMGµmn]?(?:N|Pa|m|s|g|J|V|Hz)(?:[²³⁴]|⁻¹)?|min|h|d|deg|%|°)"
_PRINTED_UNIT = rf"(?:1?/?{_UNIT_PART}(?:[/·]{_UNIT_PART})*)"
_PRINTED_NUMBER = r"[−+±<≤≥~-]?\s?[\d.]+(?:e[+−-]?\d+)?(?:\s?×\s?10[⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+)?"
_PRINTED_QUANTITY = re.compile(
    rf"(?:{_PRINTED_NUMBER}(?:\s{_PRINTED_UNIT})?|{_PRINTED_UNIT}|{_PRINTED_NUMBER}\s(?:h|min)\s{_PRINTED_NUMBER}\s(?:min|s))$"
)
# What a study, a file or a machine calls its own: paths, keys, hashes, versions, settings as a study file has them.
_OWN_WORD = re.compile(
    r"[\w./-]+\.(?:csv|toml|json|xlsx|stl)$|[0-9a-f]{8,64}$|\d{4}-\d\d-\d\d(?:[T ][\d:.+Z]+)?$|rso [a-z]+ \S+|"
    r"N-mm-MPa-s$|(?:[\w-]+ \d+\.[\w.]+, )+|(?:[a-z_ ]+: )?[a-z][a-z_0-9]+ = \S.*(?<!\.)$|"
    r"\d+\.\d+\.\S+, \d+\.\d+|(?:Python )?\d+\.\d+\.\d+$"
)
_LOOKUP_LETTERS = 4  # letters by which templates are looked up
_SLOT_FORMS = {"n": r"[−+±<≤≥~-]?[\d.]+(?:e[+−-]?\d+)?(?:\s?×\s?10[⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+)?", "w": r"[^\s,;:]+"}


@dataclass(frozen=True)
class SentenceTemplate:
    """An English sentence or phrase with slots, and the same in another language."""

    english: str
    other: str
    topic: str

    @functools.cached_property
    def patterns(self) -> tuple[re.Pattern[str], ...]:
        """What the English one matches, each slot a group of its name: first slots short, or long."""
        return self._pattern(".+?"), self._pattern(".+")

    def _pattern(self, anything: str) -> re.Pattern[str]:
        parts, end, seen = [], 0, set[str]()
        for m in _TEMPLATE_SLOT.finditer(self.english):
            parts.append(_spaced(self.english[end : m.start()]))
            form = _SLOT_FORMS.get(m[1].partition("_")[0], anything) if "_" in m[1] else anything
            parts.append(f"(?P={m[1]})" if m[1] in seen else f"(?P<{m[1]}>{form})")
            seen.add(m[1])
            end = m.end()
        return re.compile("".join([*parts, _spaced(self.english[end:])]), re.DOTALL)

    @functools.cached_property
    def fixed(self) -> tuple[str, str, str]:
        """What stands before its first slot and behind its last one, and its longest piece, all single spaced."""
        pieces = _TEMPLATE_SLOT.sub("\0", re.sub(r"\s+", " ", self.english)).split("\0")
        return pieces[0], pieces[-1], max(pieces, key=len)

    @functools.cached_property
    def weight(self) -> int:
        """Letters that are its own."""
        return len(_TEMPLATE_SLOT.sub("", self.english))


def _spaced(text: str) -> str:
    """A pattern of a text in which any white space is as good as any other."""
    return r"\s+".join(re.escape(p) for p in re.split(r"\s+", text)) if text.strip() else re.sub(r"\s+", r"\\s+", text)


@dataclass(frozen=True, eq=False)
class Catalogue:
    """All templates of a language; texts that have none are collected in `missing` and stay as they are."""

    language: str
    comma: str
    templates: tuple[SentenceTemplate, ...]
    kept: frozenset[str] = frozenset()  # words of the study that stay: names of experiments, files, parameters
    missing: dict[str, None] = field(default_factory=dict)
    _known: dict[str, str | None] = field(default_factory=dict)

    @functools.cached_property
    def _whole(self) -> dict[str, str]:
        return {" ".join(t.english.split()): t.other for t in self.templates if not _TEMPLATE_SLOT.search(t.english)}

    @functools.cached_property
    def _slotted(self) -> dict[str, list[SentenceTemplate]]:
        """Templates with slots by their first letters, the heaviest first; all of them have those that have none."""
        slotted = sorted((t for t in self.templates if _TEMPLATE_SLOT.search(t.english)), key=lambda t: -t.weight)
        starts = {t.fixed[0][:_LOOKUP_LETTERS] for t in slotted}
        return {s: [t for t in slotted if s.startswith(t.fixed[0][:_LOOKUP_LETTERS])] for s in {"", *starts}}

    def _candidates(self, said: str) -> list[SentenceTemplate]:
        """Templates with slots that have their words in common with a single-spaced text, the heaviest first."""
        starts = self._slotted
        near = next(starts[said[:n]] for n in range(_LOOKUP_LETTERS, -1, -1) if said[:n] in starts)
        found = []
        for t in near:
            start, end, longest = t.fixed
            if longest in said and said.startswith(start) and said.endswith(end):
                found.append(t)
        return found

    def numbers(self, text: str) -> str:
        """Decimal numbers as the language writes them; versions and names of files stay."""
        return _DECIMAL_NUMBER.sub(rf"\1{self.comma}\2", text)

    def text(self, said: str) -> str:
        """A paragraph, sentence by sentence; one that is a template as a whole goes first."""
        if (found := self.phrase(said)) is not None:
            return found
        parts = _SENTENCE_GAP.split(said)
        return " ".join(self._sentence(p) for p in parts)

    def _sentence(self, said: str) -> str:
        found = self.phrase(said)
        if found is None:
            self.missing.setdefault(said)
            return self.numbers(said)
        return found

    def phrase(self, said: str) -> str | None:
        """A sentence or a part of one; None where there is no template for it."""
        stripped = said.strip()
        if stripped in self.kept or _OWN_WORD.match(stripped):
            return said
        if _WORDLESS_TEXT.match(stripped) or _PRINTED_QUANTITY.match(stripped):
            return self.numbers(said)
        if stripped not in self._known:
            self._known[stripped] = self._found(stripped)
        return self._known[stripped]

    def _found(self, stripped: str) -> str | None:
        single = " ".join(stripped.split())
        if (found := self._whole.get(single)) is not None:
            return self.numbers(found)
        for t in self._candidates(single):
            for pattern in t.patterns:
                if (m := pattern.fullmatch(stripped)) and (filled := self._filled(t, m)) is not None:
                    return filled
        return None

    def _filled(self, t: SentenceTemplate, m: re.Match[str]) -> str | None:
        """The other sentence with its slots filled; None where a phrase within has no template."""
        values: dict[str, str] = {}
        for name, mark in _TEMPLATE_SLOT.findall(t.english):
            if not mark:
                if _SENTENCE_GAP.search(m[name]):  # another sentence is no part of this one
                    return None
                values[name] = self.numbers(m[name])
            elif (inner := self.phrase(m[name])) is not None:
                values[name] = inner
            else:
                return None
        return _TEMPLATE_SLOT.sub(lambda s: values[s[1]], t.other)


def languages() -> list[str]:
    """Codes of the languages that a report can be written in, beside English."""
    return sorted(p.name for p in _LANGUAGES_FOLDER.iterdir() if p.is_dir() and (p / "language.toml").is_file())


@functools.lru_cache
def _read(language: str) -> tuple[str, tuple[SentenceTemplate, ...]]:
    folder = _LANGUAGES_FOLDER / language
    comma = tomllib.loads((folder / "language.toml").read_text("utf-8"))["decimal"]
    found: list[SentenceTemplate] = []
    for path in sorted(folder.glob("*.toml")):
        if path.name != "language.toml":
            rows = tomllib.loads(path.read_text("utf-8"))
            found += [SentenceTemplate(english, other, path.stem) for english, other in rows.items()]
    return comma, tuple(found)


def sentences_of(language: str, kept: frozenset[str] = frozenset()) -> Catalogue:
    """The templates of a language; ValueError that names the languages for another one."""
    if language not in languages():
        raise ValueError(f"language {language!r}: reports are written in en, {', '.join(languages())}")
    comma, templates = _read(language)
    return Catalogue(language, comma, templates, kept)
