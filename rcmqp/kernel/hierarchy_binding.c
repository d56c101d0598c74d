/* solve(): the hierarchy for Python, and what a step has in common with it. */

#define NO_IMPORT_ARRAY
#include "blocks.h"

#include <math.h>

/* Of the active set; 0 is for accounting alone. */
#define MOST_ROUNDS 10000

/* Rows, of levels or hard, that a problem may have. */
#define MOST_ROWS 5000

/* A new array (rows), or (rows, columns), that cannot be written. */
PyObject *copied(const double *numbers, int rows, int columns)
{
    npy_intp shape[2] = {rows, columns < 0 ? 0 : columns};
    PyObject *array = PyArray_SimpleNew(columns < 0 ? 1 : 2, shape, NPY_DOUBLE);
    if (array == NULL) return NULL;
    memcpy(PyArray_DATA((PyArrayObject *)array), numbers,
           sizeof(double) * (size_t)rows * (size_t)(columns < 0 ? 1 : columns));
    PyArray_CLEARFLAGS((PyArrayObject *)array, NPY_ARRAY_WRITEABLE);
    return array;
}

/* backend(level, M, c, R, lower, upper) -> 1, -1 or 0 for each row of R, as float64. */
static int ask(void *backend, int level, const Problem *problem, const int *rows, double *set)
{
    const int m = problem->m, r = problem->r, k = problem->k;
    PyObject *answer = PyObject_CallFunction(
        backend, "iNNNNN", level, copied(problem->M, m, r), copied(problem->c, m, -1),
        copied(problem->R, k, r), copied(problem->lower, k, -1), copied(problem->upper, k, -1));
    if (answer == NULL) return -1;
    const double *sides = numbers_of(answer, NPY_DOUBLE, k, "the backend's active set");
    for (int i = 0; sides != NULL && i < k; ++i)
        set[rows[i]] = (double)((sides[i] > 0.0) - (sides[i] < 0.0));
    Py_DECREF(answer);
    return sides == NULL ? -1 : 0;
}

/* Room for the numbers of an Answer (qp/levels.py), in its order, and where each part stands. */
static void make_space(Solved *solved, Arena *arena)
{
    const Hierarchy *hierarchy = &solved->hierarchy;
    Solution *solution = &solved->solution;
    const int n = hierarchy->n, m = hierarchy->m, N = n + m, count = hierarchy->levels + 1;
    const int rows = (int)hierarchy->ends[count - 2];
    solved->size = 3 * n + rows + m + 2 * N + count * (N + COLUMNS);
    double *at = solved->numbers = take(arena, solved->size);
    solution->v = at += 2 * n;
    solution->residual = at += n;
    solution->violation = at += rows;
    solution->touching = at += m;
    solution->multipliers = at += 2 * N;
    solution->info = at + count * N;
}

/* Solve what solved->hierarchy asks, in an arena with memory_for() of it, which keeps the answer and
 * what its account is made of. start: v where there is nothing to solve, or NULL; sets (levels + 1,
 * SETS, N). Returns 0, or -1 where the backend raised. */
int solve_in(Solved *solved, const double *start, double *sets, PyObject *backend, Arena *arena)
{
    Hierarchy *hierarchy = &solved->hierarchy;
    const size_t size = sizeof(double) * (size_t)hierarchy->n;
    make_space(solved, arena);
    memcpy(solved->numbers, hierarchy->lower, size);
    memcpy(solved->numbers + hierarchy->n, hierarchy->upper, size);
    hierarchy->lower = solved->numbers; /* a backend may write into the caller's box */
    hierarchy->upper = solved->numbers + hierarchy->n;
    if (start != NULL) memcpy(solved->solution.v, start, size);
    return solve_hierarchy(hierarchy, sets, &solved->solution, backend == Py_None ? NULL : ask,
                           backend, arena);
}

/* Whether the levels end where the rows do, and the last is not guarded: it keeps its directions
 * free, so the hard rows after it would undo it. If not, with a Python error. */
int check_levels(const Hierarchy *hierarchy, npy_intp rows)
{
    int64_t last = 0;
    int rising = hierarchy->levels >= 1;
    for (int k = 0; k < hierarchy->levels; ++k) {
        if (hierarchy->ends[k] < last) rising = 0;
        last = hierarchy->ends[k];
    }
    if (rows > MOST_ROWS || hierarchy->m > MOST_ROWS) {
        PyErr_Format(PyExc_ValueError, "%zd rows and %d hard rows; at most %d of each",
                     (Py_ssize_t)rows, hierarchy->m, MOST_ROWS);
        return 0;
    }
    if (rising && last == rows && hierarchy->guarded >= 0 &&
        hierarchy->guarded < hierarchy->levels)
        return 1;
    PyErr_SetString(PyExc_ValueError, "ends must rise to the number of rows, and guarded be less "
                                      "than the number of levels");
    return 0;
}

/* solve(A, b, ends, damping, lower, upper, C, d, guarded, sluggish,
 * max_rounds, v, sets, backend) */
PyObject *solve(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    (void)self;
    if (!counted("solve", count, 14)) return NULL;
    const npy_intp m = size_of(args[7]), rows = size_of(args[1]);
    const npy_intp n = rows > 0 ? size_of(args[0]) / rows : 0;
    Solved solved = {.hierarchy = {
        (int)n,
        (int)m,
        (int)size_of(args[2]),
        numbers_of(args[0], NPY_DOUBLE, rows * n, "A"),
        numbers_of(args[1], NPY_DOUBLE, rows, "b"),
        numbers_of(args[2], NPY_INT64, -1, "ends"),
        numbers_of(args[3], NPY_DOUBLE, size_of(args[2]), "damping"),
        numbers_of(args[4], NPY_DOUBLE, n, "lower"),
        numbers_of(args[5], NPY_DOUBLE, n, "upper"),
        numbers_of(args[6], NPY_DOUBLE, m * n, "C"),
        numbers_of(args[7], NPY_DOUBLE, m, "d"),
        count_of(args[8], 1000, "guarded"),
        count_of(args[9], 1, "sluggish"),
        count_of(args[10], MOST_ROUNDS, "max_rounds"),
    }};
    const Hierarchy *hierarchy = &solved.hierarchy;
    if (PyErr_Occurred() || !check_levels(hierarchy, rows)) return NULL;
    double *sets = space_of(args[12], (npy_intp)(hierarchy->levels + 1) * SETS * (n + m), "sets");
    const double *start = args[11] == Py_None ? NULL : numbers_of(args[11], NPY_DOUBLE, n, "v");
    if (PyErr_Occurred()) return NULL;
    const size_t size = memory_for((int)n, (int)m, (int)rows, hierarchy->levels);
    Arena own = {NULL, 0}, *arena = &own; /* the backend may call back into the module's scratch */
    if (args[13] == Py_None)
        arena = scratch(size);
    else if ((own.memory = PyMem_RawMalloc(sizeof(double) * size)) == NULL)
        return PyErr_NoMemory();
    PyObject *v = NULL, *told = NULL, *answer = NULL;
    if (arena != NULL && !solve_in(&solved, start, sets, args[13], arena)) {
        v = copied(solved.solution.v, (int)n, -1);
        told = make_account(&solved, *arena, NULL, NULL, NULL);
    }
    if (v != NULL && told != NULL) answer = PyTuple_Pack(2, v, told);
    Py_XDECREF(v);
    Py_XDECREF(told);
    PyMem_RawFree(own.memory);
    return answer;
}
