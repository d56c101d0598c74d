/* Levels in order of priority, and the manipulability of RCM and tip, for Python; see _kernel.pyi. */

#define NO_IMPORT_ARRAY
#include "blocks.h"
#include "manipulability.h"
#include "priority.h"

/* Levels, and rows and columns of one. */
#define MOST_LEVELS 8
#define MOST_SIZE 1000

/* A tuple (A, b) for *n unknowns; where that is negative, it becomes what A has. 0 with an error. */
static int read_goal(PyObject *level, npy_intp *n, Goal *goal)
{
    if (!PyTuple_Check(level) || PyTuple_GET_SIZE(level) != 2) {
        PyErr_SetString(PyExc_TypeError, "a level must be a tuple (A, b)");
        return 0;
    }
    PyObject *A = PyTuple_GET_ITEM(level, 0), *b = PyTuple_GET_ITEM(level, 1);
    const npy_intp m = size_of(b);
    if (*n < 0 && m > 0) *n = size_of(A) / m;
    if (m < 1 || m > MOST_SIZE || *n < 1 || *n > MOST_SIZE) {
        PyErr_Format(PyExc_ValueError, "a level must have 1 to %d rows and unknowns", MOST_SIZE);
        return 0;
    }
    if (!PyArray_Check(A) || PyArray_NDIM((PyArrayObject *)A) != 2 ||
        PyArray_DIM((PyArrayObject *)A, 0) != m) {
        PyErr_SetString(PyExc_ValueError, "A of a level must have a row for each number of b");
        return 0;
    }
    *goal = (Goal){
        (int)m,
        numbers_of(A, NPY_DOUBLE, m * *n, "A"),
        numbers_of(b, NPY_DOUBLE, m, "b"),
    };
    return !PyErr_Occurred();
}

/* in_order(levels, inverse, rest or None): v and the least singular value of the last level. */
PyObject *in_order(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    (void)self;
    if (!counted("in_order", count, 3)) return NULL;
    const Py_ssize_t levels = PyTuple_Check(args[0]) ? PyTuple_GET_SIZE(args[0]) : 0;
    if (levels < 1 || levels > MOST_LEVELS) {
        PyErr_Format(PyExc_ValueError, "levels must be a tuple of 1 to %d", MOST_LEVELS);
        return NULL;
    }
    Goal goals[MOST_LEVELS];
    npy_intp n = args[2] == Py_None ? -1 : size_of(args[2]);
    int most = 0;
    for (Py_ssize_t k = 0; k < levels; ++k) {
        if (!read_goal(PyTuple_GET_ITEM(args[0], k), &n, goals + k)) return NULL;
        if (goals[k].m > most) most = goals[k].m;
    }
    const double *inverse = numbers_of(args[1], NPY_DOUBLE, INVERSE_NUMBERS, "inverse");
    const double *rest = args[2] == Py_None ? NULL : numbers_of(args[2], NPY_DOUBLE, n, "rest");
    if (PyErr_Occurred()) return NULL;
    Arena *arena = scratch(memory_for_order((int)n, (int)levels, most));
    PyObject *v = arena == NULL ? NULL : PyArray_SimpleNew(1, &n, NPY_DOUBLE);
    if (v == NULL) return NULL;
    const double least = serve_levels(goals, (int)levels, (int)n, inverse, rest,
                                      PyArray_DATA((PyArrayObject *)v), arena);
    return Py_BuildValue("(Nd)", v, least);
}

/* manipulability(cycle ...): m and g (SHAFT_ROWS). */
PyObject *manipulability(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    (void)self;
    Cycle cycle;
    if (!counted("manipulability", count, CYCLE_ARGUMENTS) || !read_cycle(args, &cycle))
        return NULL;
    npy_intp size = SHAFT_ROWS;
    if (cycle.n < 1 || cycle.n > MOST_SIZE || cycle.x_t != NULL) {
        PyErr_SetString(PyExc_ValueError, "an arm needs joints, and no wrist");
        return NULL;
    }
    Arena *arena = scratch(memory_for_manipulability(cycle.n));
    PyObject *g = arena == NULL ? NULL : PyArray_SimpleNew(1, &size, NPY_DOUBLE);
    if (g == NULL) return NULL;
    const double m = shaft_manipulability(&cycle, PyArray_DATA((PyArrayObject *)g), arena);
    return Py_BuildValue("(dN)", m, g);
}
