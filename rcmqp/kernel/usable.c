/* usable(): whether a controller can work with the numbers of a cycle. */

#define NO_IMPORT_ARRAY
#include "arrays.h"

#include <math.h>

PyObject *usable(PyObject *self, PyObject *const *args, Py_ssize_t count);

/* Whether compiled code can read it as float64. */
static int is_readable(PyObject *object)
{
    return PyArray_Check(object) && PyArray_TYPE((PyArrayObject *)object) == NPY_DOUBLE &&
           PyArray_ISCARRAY_RO((PyArrayObject *)object);
}

/* The numbers of a vector of `size` (-1: any) finite ones; 0 if it is none. */
static int vector_of(PyObject *object, npy_intp size, const double **numbers)
{
    PyArrayObject *array = (PyArrayObject *)object;
    if (!is_readable(object) || PyArray_NDIM(array) != 1 ||
        (size >= 0 && PyArray_DIM(array, 0) != size))
        return 0;
    *numbers = PyArray_DATA(array);
    return are_finite(*numbers, PyArray_DIM(array, 0));
}

/* usable(J_local, x, angles, q, v, a, x_d, x_d_dot, pivot, pivot_dot, tolerance): arrays that compiled
 * code can read; from q on all finite and of the right sizes; and x_d a pose, |P| = 1 and P.D = 0 to
 * the tolerance. What is not usable, Python mends, or says in words. */
PyObject *usable(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    static const npy_intp sizes[7] = {-1, -1, -1, 8, 8, 3, 3};
    const double *numbers, *x_d = NULL;
    (void)self;
    if (!counted("usable", count, 11)) return NULL;
    for (int i = 0; i < 3; ++i)
        if (!is_readable(args[i])) Py_RETURN_FALSE;
    for (int i = 0; i < 7; ++i) {
        if (!vector_of(args[i + 3], sizes[i], &numbers)) Py_RETURN_FALSE;
        if (i == 3) x_d = numbers;
    }
    const double tolerance = number_of(args[10]);
    if (PyErr_Occurred()) return NULL;
    const double size = sqrt(dot(x_d, x_d, 4)), mixed = dot(x_d, x_d + 4, 4);
    return PyBool_FromLong(fabs(size - 1.0) <= tolerance && fabs(mixed) <= tolerance);
}
