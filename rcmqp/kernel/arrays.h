/* Python arguments: float64 and int64 arrays, C-contiguous, of the sizes that are expected.
 *
 * Once one has failed no other is looked at: Python must not be called with an error set. */
#ifndef RCMQP_ARRAYS_H
#define RCMQP_ARRAYS_H

#define PY_SSIZE_T_CLEAN
#include <Python.h>
#define NPY_NO_DEPRECATED_API NPY_1_7_API_VERSION
#define PY_ARRAY_UNIQUE_SYMBOL rcmqp_ARRAY_API
#include <numpy/arrayobject.h>

#include "linalg.h"

/* How many numbers an array has; PyArray_SIZE() is a call. */
static inline npy_intp numbers_count(PyArrayObject *array)
{
    npy_intp count = 1;
    for (int i = 0; i < PyArray_NDIM(array); ++i) count *= PyArray_DIM(array, i);
    return count;
}

/* The numbers of an array of `size` numbers (-1: any); NULL, with a Python error, if it is not
 * C-contiguous, aligned and of the machine's byte order. */
static inline void *numbers_of(PyObject *object, int type, npy_intp size, const char *name)
{
    PyArrayObject *array = (PyArrayObject *)object;
    if (PyErr_Occurred()) return NULL;
    if (!PyArray_Check(object) || PyArray_TYPE(array) != type || !PyArray_ISCARRAY_RO(array)) {
        PyErr_Format(PyExc_TypeError, "%s must be a C-contiguous array of native %s", name,
                     type == NPY_DOUBLE ? "float64" : "int64");
        return NULL;
    }
    if (size >= 0 && numbers_count(array) != size) {
        PyErr_Format(PyExc_ValueError, "%s has %zd numbers, expected %zd", name,
                     (Py_ssize_t)numbers_count(array), (Py_ssize_t)size);
        return NULL;
    }
    return PyArray_DATA(array);
}

/* The same, of an array that is written to. */
static inline double *space_of(PyObject *object, npy_intp size, const char *name)
{
    double *numbers = numbers_of(object, NPY_DOUBLE, size, name);
    if (numbers != NULL && !PyArray_ISWRITEABLE((PyArrayObject *)object)) {
        PyErr_Format(PyExc_ValueError, "%s is read-only", name);
        return NULL;
    }
    return numbers;
}

/* A number; -1, with a Python error, if it is none. A method __float__ of a class in Python is not
 * called, and of numpy's scalars only real ones are taken, since complex ones warn in Python: either
 * could do away with arrays whose numbers are in use. */
static inline double number_of(PyObject *object)
{
    if (PyErr_Occurred()) return -1.0;
    if (PyFloat_Check(object)) return PyFloat_AS_DOUBLE(object);
    if (PyLong_Check(object)) return PyLong_AsDouble(object);
    const int is_real = PyArray_IsScalar(object, Floating) || PyArray_IsScalar(object, Integer);
    if (is_real && !(Py_TYPE(object)->tp_flags & Py_TPFLAGS_HEAPTYPE))
        return PyFloat_AsDouble(object);
    PyErr_Format(PyExc_TypeError, "%s given, it must be a number", Py_TYPE(object)->tp_name);
    return -1.0;
}

/* A count from 0 to `most`; -1, with a Python error, if it is none; calls no Python either. */
static inline int count_of(PyObject *object, long most, const char *name)
{
    int overflow = 0;
    if (PyErr_Occurred()) return -1;
    if (!PyLong_Check(object)) {
        PyErr_Format(PyExc_TypeError, "%s must be an int", name);
        return -1;
    }
    const long value = PyLong_AsLongAndOverflow(object, &overflow);
    if (PyErr_Occurred()) return -1;
    if (overflow || value < 0 || value > most) {
        PyErr_Format(PyExc_ValueError, "%s must be from 0 to %ld", name, most);
        return -1;
    }
    return (int)value;
}

/* Whatever numpy makes an array of, as float64, C-contiguous; itself where it is that already. */
static inline PyArrayObject *numbers_in(PyObject *object)
{
    PyArrayObject *array = (PyArrayObject *)object;
    if (PyArray_Check(object) && PyArray_TYPE(array) == NPY_DOUBLE && PyArray_ISCARRAY_RO(array))
        return (PyArrayObject *)Py_NewRef(object);
    return (PyArrayObject *)PyArray_FROM_OTF(object, NPY_DOUBLE, NPY_ARRAY_IN_ARRAY);
}

/* Whether it is a vector of that size. */
static inline int is_vector(PyArrayObject *array, npy_intp size)
{
    return PyArray_NDIM(array) == 1 && PyArray_DIM(array, 0) == size;
}

static inline npy_intp size_of(PyObject *object)
{
    return PyArray_Check(object) ? numbers_count((PyArrayObject *)object) : -1;
}

/* Whether there are as many arguments as expected, with a Python error if not. */
static inline int counted(const char *name, Py_ssize_t count, Py_ssize_t expected)
{
    if (count == expected) return 1;
    PyErr_Format(PyExc_TypeError, "%s() takes %zd arguments, %zd given", name, expected, count);
    return 0;
}

/* An instance of a dataclass with slots, see records.c. */
PyObject *record_of(PyObject *cls, PyObject *const *fields, Py_ssize_t count);

/* Scratch of at least `count` numbers, the same memory for every call: the GIL is held. */
Arena *scratch(size_t count);

#endif
