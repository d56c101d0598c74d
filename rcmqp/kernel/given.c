/* Rows that Python gives, as tasks and limits of a stack. */

#define NO_IMPORT_ARRAY
#include "given.h"

#include <math.h>

#define MOST_ARRAYS 4

/* The arrays of a tuple: -1 with an error. */
static int read_arrays(PyObject *given, int count, PyArrayObject **arrays)
{
    if (!PyTuple_Check(given) || PyTuple_GET_SIZE(given) != count) {
        PyErr_SetString(PyExc_TypeError, "given rows are tuples (error, jacobian, drift) of a task, "
                                         "(lower, upper, C, d) of a limit");
        return -1;
    }
    for (int i = 0; i < count; ++i) {
        arrays[i] = (PyArrayObject *)PyTuple_GET_ITEM(given, i);
        if (numbers_of(PyTuple_GET_ITEM(given, i), NPY_DOUBLE, -1, "an array of given rows") == NULL)
            return -1;
    }
    return 0;
}

static int is_matrix(PyArrayObject *array, npy_intp rows, npy_intp columns)
{
    return PyArray_NDIM(array) == 2 && PyArray_DIM(array, 0) == rows &&
           (PyArray_DIM(array, 1) == columns || rows == 0);
}

/* Given rows of a task: 1; 0 where they do not fit or a number is not finite; -1 with an error. */
static int read_task(StackTask *task, PyObject *given, int n)
{
    PyArrayObject *arrays[MOST_ARRAYS];
    if (read_arrays(given, 3, arrays) < 0) return -1;
    const npy_intp m = PyArray_SIZE(arrays[0]);
    if (!is_matrix(arrays[1], m, n) || !is_vector(arrays[2], m)) return 0;
    task->m = (int)m, task->error = PyArray_DATA(arrays[0]);
    task->jacobian = PyArray_DATA(arrays[1]), task->drift = PyArray_DATA(arrays[2]);
    return are_finite(task->error, m) && are_finite(task->jacobian, m * n) &&
           are_finite(task->drift, m);
}

/* The same for the box and the rows of a limit. */
static int read_limit(StackLimit *limit, PyObject *given, int n)
{
    PyArrayObject *arrays[MOST_ARRAYS];
    if (read_arrays(given, 4, arrays) < 0) return -1;
    const npy_intp m = PyArray_SIZE(arrays[3]);
    if (!is_vector(arrays[0], n) || !is_vector(arrays[1], n) || !is_matrix(arrays[2], m, n))
        return 0;
    limit->m = (int)m, limit->lower = PyArray_DATA(arrays[0]);
    limit->upper = PyArray_DATA(arrays[1]), limit->C = PyArray_DATA(arrays[2]);
    limit->d = PyArray_DATA(arrays[3]);
    for (int i = 0; i < n; ++i)
        if (!(limit->lower[i] <= limit->upper[i]) || limit->lower[i] == INFINITY ||
            limit->upper[i] == -INFINITY)
            return 0;
    for (npy_intp i = 0; i < m; ++i)
        if (!(limit->d[i] > -INFINITY)) return 0;
    return are_finite(limit->C, m * n);
}

/* All rows that are given, in the order of the tasks, then of the limits: 1; 0 where they are too
 * few or many, do not fit, or are not finite; -1 with a Python error. The arrays live as long as `given`. */
int read_given(Stack *stack, PyObject *given)
{
    Py_ssize_t next = 0;
    int fit = 1;
    for (int k = 0; k < stack->task_count + stack->limit_count && fit > 0; ++k) {
        StackTask *task = stack->tasks + k;
        StackLimit *limit = stack->limits + (k - stack->task_count);
        const int is_task = k < stack->task_count;
        const Block *block = is_task ? task->block : limit->block;
        if (block != NULL) {
            *(is_task ? &task->m : &limit->m) = rows_of(block, stack->n);
            continue;
        }
        if (next == PyList_GET_SIZE(given)) return 0;
        PyObject *rows = PyList_GET_ITEM(given, next++);
        fit = is_task ? read_task(task, rows, stack->n) : read_limit(limit, rows, stack->n);
    }
    if (fit > 0 && next != PyList_GET_SIZE(given)) fit = 0;
    return fit;
}
