/* usable(): whether a controller can work with the numbers of a cycle. */

#define NO_IMPORT_ARRAY
#include "arrays.h"

#include <math.h>

PyObject *usable(PyObject *self, PyObject *const *args, Py_ssize_t count);

static int vector_of(PyObject *object, npy_intp size, const double **numbers)
{
    PyArrayObject *array = (PyArrayObject *)object;
    if (!PyArray_Check(object) || PyArray_TYPE(array) != NPY_DOUBLE || PyArray_NDIM(array) != 1 ||
        !PyArray_ISCARRAY_RO(array) || (size >= 0 && PyArray_SIZE(array) != size))
        return 0;
    *numbers = PyArray_DATA(array);
    for (npy_intp i = 0; i < PyArray_SIZE(array); ++i)
        if (!(fabs((*numbers)[i]) < INFINITY)) return 0;
    return 1;
}

/* usable(q, v, x_d, x_d_dot, pivot, pivot_dot, tolerance): all finite, of the right sizes, and
 * x_d a pose, |P| = 1 and P.D = 0 to the tolerance. What is not usable, Python says in words. */
PyObject *usable(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    static const npy_intp sizes[6] = {-1, -1, 8, 8, 3, 3};
    const double *numbers, *x_d = NULL;
    (void)self;
    if (count != 7) {
        PyErr_Format(PyExc_TypeError, "usable() takes 7 arguments, %zd given", count);
        return NULL;
    }
    for (int i = 0; i < 6; ++i) {
        if (!vector_of(args[i], sizes[i], &numbers)) Py_RETURN_FALSE;
        if (i == 2) x_d = numbers;
    }
    const double tolerance = PyFloat_AsDouble(args[6]);
    if (PyErr_Occurred()) return NULL;
    const double size = sqrt(dot(x_d, x_d, 4)), mixed = dot(x_d, x_d + 4, 4);
    return PyBool_FromLong(fabs(size - 1.0) <= tolerance && fabs(mixed) <= tolerance);
}
