"""The kinds of designs that there are: every file of `rso.doe.samplers`, by its name in `doe.kind`."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Mapping
from types import MappingProxyType

from rso.doe import samplers
from rso.doe.sampler import Sampler


def _found() -> Mapping[str, Sampler]:
    names = sorted(m.name for m in pkgutil.iter_modules(samplers.__path__))
    kinds = [importlib.import_module(f"{samplers.__name__}.{name}").SAMPLER for name in names]
    return MappingProxyType({s.name: s for s in kinds})


SAMPLERS = _found()
