/* Whole blocks of views, references and observed poses for Python; see _kernel.pyi. */

#define NO_IMPORT_ARRAY
#include "arrays.h"
#include "contour.h"
#include "dualquaternion.h"
#include "drawn.h"
#include "reference.h"

/* A new array (rows, columns), or (rows) for no columns; *numbers are its own. */
static PyObject *table(npy_intp rows, npy_intp columns, double **numbers)
{
    const npy_intp shape[2] = {rows, columns};
    PyObject *array = PyArray_EMPTY(columns ? 2 : 1, shape, NPY_DOUBLE, 0);
    if (array != NULL) *numbers = PyArray_DATA((PyArrayObject *)array);
    return array;
}

/* store(table, k, array, ...): the arrays' numbers, one array after the other, fill row k. */
PyObject *store(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    (void)self;
    const npy_intp size = count < 2 ? -1 : size_of(args[0]);
    double *numbers = size < 0 ? NULL : space_of(args[0], size, "table");
    if (numbers == NULL || PyArray_NDIM((PyArrayObject *)args[0]) != 2) {
        if (!PyErr_Occurred()) PyErr_SetString(PyExc_TypeError, "store(table, k, array, ...)");
        return NULL;
    }
    const npy_intp *shape = PyArray_DIMS((PyArrayObject *)args[0]);
    const int k = count_of(args[1], (long)shape[0] - 1, "k");
    npy_intp filled = 0;
    for (Py_ssize_t i = 2; !PyErr_Occurred() && i < count; ++i) {
        const npy_intp n = size_of(args[i]);
        const double *given = numbers_of(args[i], NPY_DOUBLE, n, "array");
        if (given != NULL && filled + n <= shape[1])
            memcpy(numbers + shape[1] * k + filled, given, sizeof(double) * (size_t)n);
        filled += n;
    }
    if (!PyErr_Occurred() && filled != shape[1])
        PyErr_Format(PyExc_ValueError, "%zd numbers for a row of %zd", (Py_ssize_t)filled,
                     (Py_ssize_t)shape[1]);
    if (PyErr_Occurred()) return NULL;
    Py_RETURN_NONE;
}

/* views(figure, numbers, duration, ramp, times, tip_depth) */
PyObject *views(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    (void)self;
    if (!counted("views", count, 6)) return NULL;
    const Drawing drawing = {
        (Figure)count_of(args[0], LISSAJOUS, "figure"),
        numbers_of(args[1], NPY_DOUBLE, 4, "numbers"),
        number_of(args[2]),
        number_of(args[3]),
    };
    const npy_intp n = size_of(args[4]);
    const double *times = numbers_of(args[4], NPY_DOUBLE, n, "times");
    const double tip_depth = number_of(args[5]);
    if (!PyErr_Occurred() && !(drawing.duration > 0.0))
        PyErr_SetString(PyExc_ValueError, "duration must be positive");
    double *view = NULL;
    PyObject *made = PyErr_Occurred() ? NULL : table(n, VIEW_NUMBERS, &view);
    for (npy_intp k = 0; made != NULL && k < n; ++k)
        view_at(&drawing, times[k], tip_depth, view + VIEW_NUMBERS * k);
    return made;
}

/* view_poses(x_rcm, views, offsets, pivot_dots) */
PyObject *view_poses(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    (void)self;
    if (!counted("view_poses", count, 4)) return NULL;
    const npy_intp n = size_of(args[1]) / VIEW_NUMBERS;
    const double *x_rcm = numbers_of(args[0], NPY_DOUBLE, 8, "x_rcm");
    const double *view = numbers_of(args[1], NPY_DOUBLE, VIEW_NUMBERS * n, "views");
    const double *offset = numbers_of(args[2], NPY_DOUBLE, 3 * n, "offsets");
    const double *pivot_dot = numbers_of(args[3], NPY_DOUBLE, 3 * n, "pivot_dots");
    if (PyErr_Occurred()) return NULL;
    double *x_d = NULL, *x_d_dot = NULL, *pivot = NULL;
    PyObject *made[] = {table(n, 8, &x_d), table(n, 8, &x_d_dot), table(n, 3, &pivot)};
    for (npy_intp k = 0; !PyErr_Occurred() && k < n; ++k) {
        double x[8];
        memcpy(x, x_rcm, sizeof x);
        dq_carry(x, offset + 3 * k, 1.0, x);
        pose_of_view(x, view + VIEW_NUMBERS * k, pivot_dot + 3 * k, x_d + 8 * k, x_d_dot + 8 * k,
                     pivot + 3 * k);
    }
    return Py_BuildValue("(NNN)", made[0], made[1], made[2]);
}

/* observed(x, x_d, pivots, axis, tip_depth) */
PyObject *observed(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    (void)self;
    if (!counted("observed", count, 5)) return NULL;
    const npy_intp n = size_of(args[0]) / 8;
    const double *x = numbers_of(args[0], NPY_DOUBLE, 8 * n, "x");
    const double *x_d = numbers_of(args[1], NPY_DOUBLE, 8 * n, "x_d");
    const double *pivot = numbers_of(args[2], NPY_DOUBLE, 3 * n, "pivots");
    const double *axis = numbers_of(args[3], NPY_DOUBLE, 3, "axis");
    const double tip_depth = number_of(args[4]);
    if (PyErr_Occurred()) return NULL;
    double *tip = NULL, *tip_d = NULL, *seen = NULL;
    PyObject *made[] = {table(n, 3, &tip), table(n, 3, &tip_d), table(n, OBSERVED, &seen)};
    for (npy_intp k = 0; !PyErr_Occurred() && k < n; ++k)
        observe(x + 8 * k, x_d + 8 * k, pivot + 3 * k, axis, tip_depth, tip + 3 * k,
                tip_d + 3 * k, seen + OBSERVED * k);
    return Py_BuildValue("(NNN)", made[0], made[1], made[2]);
}

/* contour(points, vertices, along, first, since): point i belongs to vertex first + i. */
PyObject *contour(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    (void)self;
    if (!counted("contour", count, 5)) return NULL;
    const npy_intp n = size_of(args[0]) / 3, m = size_of(args[2]);
    const double *points = numbers_of(args[0], NPY_DOUBLE, 3 * n, "points");
    const double *vertices = numbers_of(args[1], NPY_DOUBLE, 3 * m, "vertices");
    const Curve curve = {vertices, numbers_of(args[2], NPY_DOUBLE, m, "along"), m};
    const npy_intp first = count_of(args[3], (long)(m - n), "first");
    npy_intp since = count_of(args[4], (long)first, "since");
    if (PyErr_Occurred()) return NULL;
    double *distance = NULL, *reached = NULL;
    PyObject *made[] = {table(n, 0, &distance), table(n, 0, &reached)};
    for (npy_intp i = 0; !PyErr_Occurred() && i < n; ++i) {
        distance[i] = contour_distance(&curve, points + 3 * i, first + i);
        since = contour_reached(&curve, points + 3 * i, first + i, since);
        reached[i] = (double)since;
    }
    return Py_BuildValue("(NN)", made[0], made[1]);
}
