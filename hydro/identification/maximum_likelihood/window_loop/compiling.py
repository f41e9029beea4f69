"""How the functions of the loop are compiled, and arrays of zeros for it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import numba
import numpy as np
from numba.core.compiler_lock import global_compiler_lock

from auvid.hydro.arrays import Array, Singles

OPTIONS: dict[str, Any] = {
    "error_model": "numpy",
    "fastmath": {"contract", "reassoc", "nsz"},
}
_config: Any = numba.config

F = TypeVar("F", bound=Callable[..., Any])


def compiled(function: F, *, cache: bool = False) -> F:
    """Have numba compile a function; `cache`: Python calls it, and it is kept.

    Nothing is drawn in, unlike in the simulation: the derivative stands here once, not a
    hundred times.
    """
    inner: dict[str, Any] = {"no_cpython_wrapper": not cache, "no_cfunc_wrapper": True}
    result: F = numba.njit(nogil=True, cache=cache, **inner, **OPTIONS)(function)
    return result


def second_level(compiled_loop: Any) -> Any:
    """Have a loop compiled at the second level of optimisation: a third less time.

    The third level makes it no faster. Numba has this level for a process only.
    """
    compile_for: Callable[[Any], Any] = compiled_loop.compile

    def compile_quickly(types: Any) -> Any:
        with global_compiler_lock:
            level, _config.OPT = _config.OPT, min(_config.OPT, 2)
            try:
                return compile_for(types)
            finally:
                _config.OPT = level

    compiled_loop.compile = compile_quickly
    return compiled_loop


@compiled
def vector(n: int) -> Array:
    """Return zeros (n,): one function a shape, since numba compiles each call anew."""
    return np.zeros(n)


@compiled
def matrix(n: int, m: int) -> Array:
    return np.zeros((n, m))


@compiled
def stack(n: int, m: int, k: int) -> Array:
    return np.zeros((n, m, k))


@compiled
def singles(n: int, m: int, k: int) -> Singles:
    return np.zeros((n, m, k), np.float32)
