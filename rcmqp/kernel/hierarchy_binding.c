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

/* found[names[i]] = number; 0, or 1 with a Python error */
static int put(PyObject *found, PyObject *names, int i, double number)
{
    PyObject *value = found == NULL ? NULL : PyFloat_FromDouble(number);
    const int failed =
        value == NULL || PyDict_SetItem(found, PyTuple_GET_ITEM(names, i), value) < 0;
    Py_XDECREF(value);
    return failed;
}

/* What a run records of a solve, by `names` (levels + 3): the norm of each level's residual but
 * the rest's; whether all is exact; joints at a bound; the largest excess of a hard row; the
 * largest KKT residual. HierarchySolution.summary is the same in Python. */
static PyObject *summary(const Hierarchy *hierarchy, const Solution *solution, PyObject *names)
{
    const int n = hierarchy->n, N = n + hierarchy->m, levels = hierarchy->levels;
    int exact = 1, bounded = 0, first = 0, failed = 0;
    double excess = 0.0, kkt = 0.0;
    PyObject *found = PyDict_New();
    for (int k = 0; k <= levels; ++k) {
        if (!(solution->info[k * COLUMNS + ROUTE] < UNVERIFIED)) exact = 0;
        if (k > 0 && !(solution->info[k * COLUMNS + KKT] <= kkt))
            kkt = solution->info[k * COLUMNS + KKT];
        if (k == 0 || k == levels) continue;
        const int last = (int)hierarchy->ends[k - 1];
        failed |= put(found, names, k - 1, norm_of(solution->residual + first, last - first));
        first = last;
    }
    for (int i = 0; i < n; ++i)
        if (solution->touching[i] > 0.0 || solution->touching[N + i] > 0.0) ++bounded;
    for (int i = 0; i < hierarchy->m; ++i) excess = larger(excess, solution->violation[i]);
    failed |= put(found, names, levels - 1, exact);
    failed |= put(found, names, levels, bounded);
    failed |= put(found, names, levels + 1, excess);
    failed |= put(found, names, levels + 2, kkt);
    if (failed) Py_CLEAR(found);
    return found;
}

/* The numbers of an Answer (qp/levels.py), in its order, and where each part of them stands. */
static PyObject *space_for(const Hierarchy *hierarchy, double **box, Solution *solution)
{
    const npy_intp n = hierarchy->n, m = hierarchy->m, N = n + m, count = hierarchy->levels + 1;
    const npy_intp rows = (npy_intp)hierarchy->ends[count - 2];
    npy_intp size = 3 * n + rows + m + 2 * N + count * (N + COLUMNS);
    PyObject *numbers = PyArray_SimpleNew(1, &size, NPY_DOUBLE);
    if (numbers == NULL) return NULL;
    double *at = PyArray_DATA((PyArrayObject *)numbers);
    *box = at;
    solution->v = at += 2 * n;
    solution->residual = at += n;
    solution->violation = at += rows;
    solution->touching = at += m;
    solution->multipliers = at += 2 * N;
    solution->info = at + count * N;
    return numbers;
}

/* v, all numbers and, with names, the summary of a solve, in an arena with memory_for() of it.
 * start: v where there is nothing to solve, or NULL; sets (levels + 1, SETS, N). */
PyObject *answered(const Hierarchy *hierarchy, const double *start, double *sets,
                   PyObject *backend, PyObject *names, Arena *arena)
{
    const int n = hierarchy->n, asks = backend != Py_None;
    Hierarchy problem = *hierarchy;
    Solution solution;
    double *box;
    PyObject *numbers = space_for(hierarchy, &box, &solution), *answer = NULL;
    if (numbers == NULL) return NULL;
    memcpy(box, hierarchy->lower, sizeof(double) * (size_t)n);
    memcpy(box + n, hierarchy->upper, sizeof(double) * (size_t)n);
    problem.lower = box, problem.upper = box + n;
    if (start != NULL) memcpy(solution.v, start, sizeof(double) * (size_t)n);
    if (!solve_hierarchy(&problem, sets, &solution, asks ? ask : NULL, backend, arena)) {
        PyObject *v = copied(solution.v, n, -1), *told = NULL;
        if (names != NULL) told = summary(hierarchy, &solution, names);
        PyArray_CLEARFLAGS((PyArrayObject *)numbers, NPY_ARRAY_WRITEABLE);
        if (v != NULL && (told != NULL) == (names != NULL))
            answer = PyTuple_Pack(names == NULL ? 2 : 3, v, numbers, told);
        Py_XDECREF(v);
        Py_XDECREF(told);
    }
    Py_DECREF(numbers);
    return answer;
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
    Hierarchy hierarchy = {
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
    };
    if (PyErr_Occurred() || !check_levels(&hierarchy, rows)) return NULL;
    double *sets = space_of(args[12], (npy_intp)(hierarchy.levels + 1) * SETS * (n + m), "sets");
    const double *start = args[11] == Py_None ? NULL : numbers_of(args[11], NPY_DOUBLE, n, "v");
    if (PyErr_Occurred()) return NULL;
    const size_t size = memory_for((int)n, (int)m, (int)rows, hierarchy.levels);
    Arena own = {NULL, 0}, *arena = &own; /* the backend may call back into the module's scratch */
    if (args[13] == Py_None)
        arena = scratch(size);
    else if ((own.memory = PyMem_RawMalloc(sizeof(double) * size)) == NULL)
        return PyErr_NoMemory();
    PyObject *answer =
        arena == NULL ? NULL : answered(&hierarchy, start, sets, args[13], NULL, arena);
    PyMem_RawFree(own.memory);
    return answer;
}
