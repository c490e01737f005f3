"""What every table of study.toml shares."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict


class StudyFileTable(BaseModel):
    """What all tables share: no unknown keys, no conversions behind one's back, no changes afterwards."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, use_attribute_docstrings=True)
