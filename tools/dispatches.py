"""Run the numeric tests as other processors would: other vector instructions, other
BLAS kernels, other numbers of BLAS threads.

    python tools/dispatches.py [NAME]... [-- PYTEST ARGUMENTS]

Numbers that a test holds may not depend on these. Without a name, all of `DISPATCHES`
run, each on the tests of `make test` that hold numbers.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
TESTS = (
    "tests/unit/hydro",
    "tests/unit/stages",
    "tests/properties",
    "tests/end_to_end/test_golden.py",
    "tests/end_to_end/test_known_truth.py",
    "tests/end_to_end/test_twin_short.py",
    "tests/end_to_end/test_hauv_circle.py",
    "tests/end_to_end/test_hauv_control.py",
)
"""Tests that hold numbers."""
AVX512 = "X86_V4 AVX512_ICL AVX512_SPR"
DISPATCHES = {
    "avx512": {"OPENBLAS_CORETYPE": "SkylakeX"},
    "no-avx512": {"NPY_DISABLE_CPU_FEATURES": AVX512, "OPENBLAS_CORETYPE": "Haswell"},
    "no-avx2": {"NPY_DISABLE_CPU_FEATURES": f"X86_V3 {AVX512}", "OPENBLAS_CORETYPE": "Nehalem"},
    "generic-numba": {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""},
    "zen": {"OPENBLAS_CORETYPE": "Zen", "NPY_DISABLE_CPU_FEATURES": AVX512},
    "two-threads": {"TEST_BLAS_THREADS": "2"},
}
"""Environment variables by name of a dispatch. numpy is told not to use instructions
above its baseline (X86_V2), OpenBLAS which kernels to take, numba which processor to
compile for.
"""
NEEDS = {"avx512": "X86_V4"}
"""Features without which a processor cannot run a dispatch, as numpy names them. Kernels of
OpenBLAS for AVX-512 multiply and add in one where the others do not.
"""


def lacking(name: str) -> str:
    """Return the feature that this processor lacks for a dispatch; empty if none."""
    from numpy._core import _multiarray_umath as umath

    needed = NEEDS.get(name, "")
    return "" if not needed or umath.__cpu_features__.get(needed) else needed


def supported(environment: dict[str, str]) -> dict[str, str]:
    """Return an environment without the features of numpy that this build does not know:
    it warns of those, and a warning fails a test.
    """
    from numpy._core import _multiarray_umath as umath

    features = environment.get("NPY_DISABLE_CPU_FEATURES", "").split()
    able = [name for name in umath.__cpu_dispatch__ if umath.__cpu_features__[name]]
    kept = [name for name in features if name in able]
    return {**environment, "NPY_DISABLE_CPU_FEATURES": " ".join(kept)}


def main() -> int:
    """Run the tests under each dispatch; print which hold; 1 if any does not."""
    words = sys.argv[1:]
    split = words.index("--") if "--" in words else len(words)
    names, arguments = words[:split], words[split + 1 :]
    unknown = set(names) - set(DISPATCHES)
    if unknown:
        print(f"unknown: {', '.join(sorted(unknown))}; there are {', '.join(DISPATCHES)}")
        return 2
    failed, left_out = [], []
    for name in names or list(DISPATCHES):
        if feature := lacking(name):
            print(f"{name}: does not run, since this processor has no {feature}", flush=True)
            left_out.append(name)
            continue
        environment = supported(DISPATCHES[name])
        settings = " ".join(f"{key}={value!r}" for key, value in environment.items() if value)
        print(f"{name}: {settings}", flush=True)
        # numba keeps what it compiles by processor: the cache may be that of all runs.
        done = subprocess.run(
            [
                *(sys.executable, "-m", "pytest", "-p", "no:cacheprovider"),
                *(arguments or ("-n", "auto", "--dist", "worksteal", "-m", "not release", *TESTS)),
            ],
            cwd=ROOT,
            env=os.environ | environment,
            check=False,
        )
        if done.returncode:
            failed.append(name)
    rest = f"; did not run: {', '.join(left_out)}" if left_out else ""
    print((f"fail: {', '.join(failed)}" if failed else "all that ran hold") + rest)
    return int(bool(failed))


if __name__ == "__main__":
    sys.exit(main())
