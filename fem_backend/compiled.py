"""Functions that numba compiles, without numba (0.3 s to import) where none of them is called."""

from __future__ import annotations

import functools
import warnings
from collections.abc import Callable
from typing import Any


class CompiledFunction:
    """A function of numbers and arrays, compiled at its first call and kept on disk where that can be.

    `py_func` is what was written.
    """

    def __init__(self, function: Callable[..., Any], options: dict[str, Any]) -> None:
        functools.update_wrapper(self, function)
        self.py_func, self._options = function, options

    @functools.cached_property
    def dispatcher(self) -> Any:
        """numba's own object; what the function calls by a name of its module becomes one too."""
        import numba

        try:
            made = numba.njit(cache=True, **self._options)(self.py_func)
        except RuntimeError as error:
            text = "compiled code can be kept nowhere, so that each process compiles it again"
            warnings.warn(f"{text}: {error}", stacklevel=2)
            made = numba.njit(**self._options)(self.py_func)
        self.__dict__["dispatcher"] = made
        names = self.py_func.__globals__
        for name, value in list(names.items()):
            if isinstance(value, CompiledFunction):
                names[name] = value.dispatcher
        return made

    def __call__(self, *arguments: Any) -> Any:
        return self.dispatcher(*arguments)


def compiled(**options: Any) -> Callable[[Callable[..., Any]], CompiledFunction]:
    """Decorator of a function for numba, with further options of `numba.njit`."""
    return lambda function: CompiledFunction(function, options)
