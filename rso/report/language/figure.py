"""The texts of a figure in another language: those that are drawn, and those for whoever points at it."""

from __future__ import annotations

import html
import json
import re
from typing import Any

from rso.report.language.catalogue import Catalogue

_SVG_TEXT = re.compile(r"(<text\b[^>]*>)([^<]*)(</text>)")
_SVG_DATA = re.compile(r'(<metadata class="data">)(.*?)(</metadata>)', re.DOTALL)


def figure_in_language(svg: str, by: Catalogue) -> str:
    """An own SVG element with its labels, numbers and data in the language of a catalogue."""
    svg = _SVG_TEXT.sub(lambda m: f"{m[1]}{html.escape(_said(html.unescape(m[2]), by), quote=False)}{m[3]}", svg)
    return _SVG_DATA.sub(lambda m: f"{m[1]}{_held(m[2], by)}{m[3]}", svg, count=1)


def _said(text: str, by: Catalogue) -> str:
    return by.text(text) if text.strip() else text


def _held(text: str, by: Catalogue) -> str:
    data = json.loads(html.unescape(text))
    return html.escape(json.dumps(_data(data, by), separators=(",", ":"), ensure_ascii=False), quote=False)


def _data(data: dict[str, Any], by: Catalogue) -> dict[str, Any]:
    if "labels" in data:
        data["labels"] = [[_said(v, by) for v in pair] for pair in data["labels"]]
    for s in data.get("series", []):
        s.update({k: _said(s[k], by) for k in ("name", "group") if s.get(k)})
    if "said" in data:
        data["said"] = [_said(v, by) for v in data["said"]]
    if "fields" in data:
        names = {k: _said(k, by) for k in data["fields"]}
        data["fields"] = {
            names[k]: {**v, "labels": [by.numbers(t) for t in v["labels"]]} for k, v in data["fields"].items()
        }
        for f in data["frames"]:
            f["v"] = {names[k]: v for k, v in f["v"].items()}
    for t in data.get("texts", []):
        t["text"] = _said(t["text"], by)
    return data
