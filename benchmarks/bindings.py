"""What a call from Python costs with the C API, nanobind and pybind11.

    python benchmarks/bindings.py     # needs nanobind, pybind11, a C and a C++ compiler

The same three functions are bound in each way, arrays taken without conversion: one of nine
arrays, as many as a control cycle has; one of three numbers; one that answers a new array. They
are called in turns and timed in the processor's time of the thread; printed is the median of 25
rounds.
"""

from __future__ import annotations

import importlib
import statistics
import subprocess
import sys
import sysconfig
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import nanobind
import numpy as np
import pybind11

from rcmqp.show.table import Table

KERNEL = Path(__file__).parents[1] / "rcmqp" / "kernel"
CALLS, ROUNDS = 20_000, 25

C = """
#include "arrays.h"
#define BOUND(name) static PyObject *name(PyObject *self, PyObject *const *args, Py_ssize_t count)
BOUND(sum)
{
    (void)self;
    if (!counted("sum", count, 9)) return NULL;
    double s = 0.0;
    for (int i = 0; i < 9; ++i) {
        const double *a = numbers_of(args[i], NPY_DOUBLE, -1, "a");
        if (a == NULL) return NULL;
        s += a[0];
    }
    return PyFloat_FromDouble(s);
}
BOUND(line)
{
    (void)self;
    if (!counted("line", count, 3)) return NULL;
    const double a = number_of(args[0]), b = number_of(args[1]), c = number_of(args[2]);
    return PyErr_Occurred() ? NULL : PyFloat_FromDouble(a * b + c);
}
BOUND(made)
{
    (void)self;
    npy_intp n = 8;
    const double *a = counted("made", count, 1) ? numbers_of(args[0], NPY_DOUBLE, 8, "a") : NULL;
    PyObject *out = a == NULL ? NULL : PyArray_SimpleNew(1, &n, NPY_DOUBLE);
    if (out != NULL) memcpy(PyArray_DATA((PyArrayObject *)out), a, 8 * sizeof(double));
    return out;
}
#define METHOD(name) {#name, (PyCFunction)(void (*)(void))name, METH_FASTCALL, ""}
static PyMethodDef methods[] = {METHOD(sum), METHOD(line), METHOD(made), {NULL, NULL, 0, NULL}};
static struct PyModuleDef module = {PyModuleDef_HEAD_INIT, "by_c", "", -1, methods, 0, 0, 0, 0};
PyMODINIT_FUNC PyInit_by_c(void)
{
    import_array();
    return PyModule_Create(&module);
}
"""

COMMON = """
static double sum(A a, A b, A c, A d, A e, A f, A g, A h, A i)
{
    return a.data()[0] + b.data()[0] + c.data()[0] + d.data()[0] + e.data()[0] + f.data()[0] +
           g.data()[0] + h.data()[0] + i.data()[0];
}
static double line(double a, double b, double c) { return a * b + c; }
"""
ASKED = ", ".join(f'N("{name}")' for name in "abcdefghi")

NANOBIND = f"""
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <cstring>
namespace nb = nanobind;
using A = nb::ndarray<const double, nb::c_contig, nb::device::cpu>;
{COMMON}
static nb::ndarray<nb::numpy, double> made(A a)
{{
    double *out = new double[8];
    const size_t n = 8;
    std::memcpy(out, a.data(), 8 * sizeof(double));
    nb::capsule own(out, [](void *p) noexcept {{ delete[] (double *)p; }});
    return nb::ndarray<nb::numpy, double>(out, 1, &n, own);
}}
#define N(name) nb::arg(name).noconvert()
NB_MODULE(by_nanobind, m)
{{
    m.def("sum", &sum, {ASKED});
    m.def("line", &line);
    m.def("made", &made, N("a"));
}}
"""

PYBIND11 = f"""
#include <pybind11/pybind11.h>
#include <pybind11/numpy.h>
#include <cstring>
namespace py = pybind11;
using A = py::array_t<double, py::array::c_style>;
{COMMON}
static A made(A a)
{{
    A out(8);
    std::memcpy(out.mutable_data(), a.data(), 8 * sizeof(double));
    return out;
}}
#define N(name) py::arg(name).noconvert()
PYBIND11_MODULE(by_pybind11, m)
{{
    m.def("sum", &sum, {ASKED});
    m.def("line", &line);
    m.def("made", &made, N("a"));
}}
"""


def build(folder: Path, name: str, source: str, more: list[str]) -> Any:
    """The module, compiled as the kernel is."""
    file = folder / (f"{name}.c" if name == "by_c" else f"{name}.cpp")
    file.write_text(source, encoding="utf-8")
    language = ["cc", "-std=c99"] if name == "by_c" else ["c++", "-std=c++17"]
    includes = [sysconfig.get_path("include"), np.get_include(), str(KERNEL)]
    out = folder / f"{name}{sysconfig.get_config_var('EXT_SUFFIX')}"
    flags = ["-O3", "-DNDEBUG", "-shared", "-fPIC", "-fvisibility=hidden", "-fno-strict-aliasing"]
    command = [*language, *flags, *(f"-I{each}" for each in includes), str(file), *more, "-o"]
    subprocess.run([*command, str(out)], check=True)
    return importlib.import_module(name)


def timed(call: Callable[..., object], *args: object) -> float:
    """Time of one call [ns]."""
    start = time.thread_time_ns()
    for _ in range(CALLS):
        call(*args)
    return (time.thread_time_ns() - start) / CALLS


def main() -> None:
    """Print a table as Markdown."""
    nano = Path(nanobind.include_dir())
    parts = [f"-I{nano}", f"-I{nano.parent}/ext/robin_map/include"]
    parts.append(str(nano.parent / "src" / "nb_combined.cpp"))
    nine, found = [np.arange(8.0) for _ in range(9)], dict[tuple[str, str], list[float]]()
    with tempfile.TemporaryDirectory() as folder:
        sys.path.insert(0, folder)
        modules = {
            "C API": build(Path(folder), "by_c", C, []),
            "nanobind": build(Path(folder), "by_nanobind", NANOBIND, parts),
            "pybind11": build(
                Path(folder), "by_pybind11", PYBIND11, [f"-I{pybind11.get_include()}"]
            ),
        }
        for _ in range(ROUNDS):
            for name, module in modules.items():
                calls = {
                    "nine arrays": timed(module.sum, *nine),
                    "three numbers": timed(module.line, 1.0, 2.0, 3.0),
                    "a new array": timed(module.made, nine[0]),
                }
                for what, took in calls.items():
                    found.setdefault((name, what), []).append(took)
    rows = [
        [name, *(f"{statistics.median(found[name, what]):.0f} ns" for what in calls)]
        for name in modules
    ]
    print(Table(["binding", *calls], rows).markdown(), end="")
    print(f"\nnanobind {nanobind.__version__}, pybind11 {pybind11.__version__}")


if __name__ == "__main__":
    main()
