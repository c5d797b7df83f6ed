#!/bin/sh
# Run the tests as other processors would: tools/other_processors.sh [PROCESSOR ...] [ARGUMENTS OF PYTEST]
#
# torch, MKL, NumPy, OpenBLAS, numba and the C library choose instructions by the processor, and other instructions and
# another number of threads round differently. All of them can be told to choose as on a lesser x86-64 processor:
#
#   this        what this one has; 4 threads
#   haswell     AVX2 and FMA, no AVX-512; 4 threads
#   x86-64-v2   SSE4.2, no AVX, no FMA; 1 thread
#
# All three if none is named. Pytest reports on standard error; standard output has a line for each processor, with what
# was in force in it. The exit status is 1 if a test failed or the instructions are not those that were asked for.
set -eu

python=.venv/bin/python
all="this haswell x86-64-v2"
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

# The features that NumPy would choose here beyond those named: it refuses to disable what it does not have.
numpy_beyond() {
    "$python" - "$@" <<'PYTHON'
import sys
from numpy._core._multiarray_umath import __cpu_dispatch__, __cpu_features__
print(*(name for name in __cpu_dispatch__ if __cpu_features__[name] and name not in sys.argv))
PYTHON
}

# Set the environment to that of processor $1, and `expected` to the beginning of what in_force says in it.
become() {
    export NUMBA_CACHE_DIR="$work/$1"             # code compiled for one processor is not for another
    export OMP_NUM_THREADS=4 MKL_DYNAMIC=FALSE    # else there are no more threads than cores
    case $1 in
    this)
        expected="torch"
        ;;
    haswell)
        export ATEN_CPU_CAPABILITY=avx2 ONEDNN_MAX_CPU_ISA=AVX2
        export MKL_ENABLE_INSTRUCTIONS=AVX2 MKL_CBWR=AVX2     # the first on Intel's processors, the second on others
        export NUMBA_CPU_NAME=haswell NUMBA_CPU_FEATURES=     # unset, numba would add all that this processor has
        export OPENBLAS_CORETYPE=Haswell
        # The C library's sines without FMA. Not below: compiled code then calls its fma(), in software 500 times slower.
        export GLIBC_TUNABLES=glibc.cpu.hwcaps=-AVX2,-FMA,-FMA4
        NPY_DISABLE_CPU_FEATURES=$(numpy_beyond AVX F16C FMA3 AVX2 X86_V3)
        export NPY_DISABLE_CPU_FEATURES
        expected="torch AVX2, NumPy 256 bits, numba haswell 256 bits, OpenBLAS Haswell"
        ;;
    x86-64-v2)
        export OMP_NUM_THREADS=1
        export ATEN_CPU_CAPABILITY=default ONEDNN_MAX_CPU_ISA=SSE41
        export MKL_ENABLE_INSTRUCTIONS=SSE4_2 MKL_CBWR=COMPATIBLE
        export NUMBA_CPU_NAME=x86-64-v2 NUMBA_CPU_FEATURES=
        export OPENBLAS_CORETYPE=Nehalem
        NPY_DISABLE_CPU_FEATURES=$(numpy_beyond SSSE3 SSE41 POPCNT SSE42)
        export NPY_DISABLE_CPU_FEATURES
        expected="torch DEFAULT, NumPy 128 bits, numba x86-64-v2 128 bits, OpenBLAS Nehalem"
        ;;
    esac
}

# What the libraries say they use.
in_force() {
    "$python" - <<'PYTHON'
import ctypes
from pathlib import Path

import numba
import numpy as np
import torch
from numba.core.registry import cpu_target
from numpy._core._multiarray_umath import __cpu_dispatch__, __cpu_features__


@numba.njit(fastmath=True)
def dot(x, y):
    total = 0.0
    for i in range(x.size):
        total += x[i] * y[i]
    return total


dot(np.ones(4), np.ones(4))
(assembly,) = dot.inspect_asm().values()
compiled = 512 if "%zmm" in assembly else 256 if "%ymm" in assembly else 128
chosen = " ".join(name for name in __cpu_dispatch__ if __cpu_features__[name])
numpy = 512 if "AVX512" in chosen or "X86_V4" in chosen else 256 if "AVX2" in chosen or "X86_V3" in chosen else 128
core = "of its own choice"
for path in (Path(np.__file__).parents[1] / "numpy.libs").glob("libscipy_openblas64_*"):
    name = ctypes.CDLL(str(path)).scipy_openblas_get_corename64_
    name.restype = ctypes.c_char_p
    core = name().decode()
target = cpu_target.target_context.codegen().magic_tuple()[1]
print(
    f"torch {torch.backends.cpu.get_cpu_capability()}, NumPy {numpy} bits, numba {target} {compiled} bits, "
    f"OpenBLAS {core}, {torch.get_num_threads()} threads"
)
PYTHON
}

named=""
while [ $# -gt 0 ]; do
    case " $all " in
    *" $1 "*) named="$named $1" && shift ;;
    *) break ;;
    esac
done

status=0
for processor in ${named:-$all}; do
    (
        become "$processor"
        says=$(in_force) || says="nothing"
        case $says in
        "$expected"*) ;;
        *) echo "$processor: in force is $says, and not $expected" && exit 1 ;;
        esac
        started=$(date +%s)
        "$python" -m pytest -q "$@" >&2 && result=passed || result=FAILED
        echo "$processor: $says: $result in $(($(date +%s) - started)) s"
        [ $result = passed ]
    ) || status=1
done
exit $status
