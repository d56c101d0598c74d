/* joint_bounds() for Python; see _kernel.pyi. */

#define NO_IMPORT_ARRAY
#include "arrays.h"
#include "rows.h"

#include <math.h>

/* joint_bounds(line, joints, angles, v, a) */
PyObject *joint_bounds(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    (void)self;
    if (!counted("joint_bounds", count, 5)) return NULL;
    npy_intp n = size_of(args[2]);
    const double *line = numbers_of(args[0], NPY_DOUBLE, LIMIT_NUMBERS, "line");
    const Cycle cycle = {
        .n = (int)n,
        .angles = numbers_of(args[2], NPY_DOUBLE, n, "angles"),
        .v = numbers_of(args[3], NPY_DOUBLE, n, "v"),
        .a = numbers_of(args[4], NPY_DOUBLE, n, "a"),
        .joints = numbers_of(args[1], NPY_DOUBLE, JOINT_NUMBERS * n, "joints"),
    };
    if (!PyErr_Occurred() && line[0] != JOINTS)
        PyErr_SetString(PyExc_ValueError, "the line is not one of joint limits");
    if (PyErr_Occurred()) return NULL;
    PyObject *low = PyArray_SimpleNew(1, &n, NPY_DOUBLE), *up = PyArray_SimpleNew(1, &n, NPY_DOUBLE);
    if (low != NULL && up != NULL) {
        double *lower = PyArray_DATA((PyArrayObject *)low);
        double *upper = PyArray_DATA((PyArrayObject *)up);
        for (npy_intp i = 0; i < n; ++i) lower[i] = -INFINITY, upper[i] = INFINITY;
        limit_rows(&cycle, line, lower, upper, NULL, NULL);
    }
    return Py_BuildValue("(NN)", low, up);
}
