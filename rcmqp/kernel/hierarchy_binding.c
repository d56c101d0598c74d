/* solve() and step(): the hierarchy for Python. */

#define NO_IMPORT_ARRAY
#include "arrays.h"
#include "approach.h"
#include "hierarchy.h"
#include "rows.h"

#include <math.h>

/* Of the active set; 0 is for accounting alone. */
#define MOST_ROUNDS 10000

/* Rows, of levels or hard, that a problem may have. */
#define MOST_ROWS 5000

static PyObject *copied(const double *numbers, int rows, int columns)
{
    npy_intp shape[2] = {rows, columns < 0 ? 0 : columns};
    PyObject *array = PyArray_SimpleNew(columns < 0 ? 1 : 2, shape, NPY_DOUBLE);
    if (array != NULL)
        memcpy(PyArray_DATA((PyArrayObject *)array), numbers,
               sizeof(double) * (size_t)rows * (size_t)(columns < 0 ? 1 : columns));
    return array;
}

/* backend(level, M, c, R, lower, upper) -> 1, -1 or 0 for each row of R, as float64. */
static int ask(void *backend, int level, const Problem *problem, const int *rows, double *guess)
{
    const int m = problem->m, r = problem->r, k = problem->k;
    PyObject *answer = PyObject_CallFunction(
        backend, "iNNNNN", level, copied(problem->M, m, r), copied(problem->c, m, -1),
        copied(problem->R, k, r), copied(problem->lower, k, -1), copied(problem->upper, k, -1));
    if (answer == NULL) return -1;
    const double *sides = numbers_of(answer, NPY_DOUBLE, k, "the backend's active set");
    for (int i = 0; sides != NULL && i < k; ++i)
        guess[rows[i]] = (double)((sides[i] > 0.0) - (sides[i] < 0.0));
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

/* What comes before a solve: the problem into `hierarchy`, in the arena; the box is written. */
typedef void (*Fill)(Hierarchy *hierarchy, double *lower, double *upper, Arena *arena);

/* v, all numbers and, with names, the summary of a solve. args: where to start if there is nothing
 * to solve, or None; guess; backend. `more` is what `fill` takes of the arena. */
static PyObject *answered(Hierarchy *hierarchy, Fill fill, size_t more, PyObject *const *args,
                          PyObject *names)
{
    const int n = hierarchy->n, N = n + hierarchy->m, levels = hierarchy->levels;
    const int rows = (int)hierarchy->ends[levels - 1], asks = args[2] != Py_None;
    const size_t count = more + memory_for(n, hierarchy->m, rows, levels);
    double *guess = space_of(args[1], (npy_intp)(levels + 1) * N, "guess"), *box;
    const double *start = NULL;
    if (args[0] != Py_None) start = numbers_of(args[0], NPY_DOUBLE, n, "v");
    if (PyErr_Occurred()) return NULL;
    Arena own = {NULL, 0}, *arena = &own; /* the backend may call back into the module's scratch */
    if (!asks)
        arena = scratch(count);
    else if ((own.memory = PyMem_RawMalloc(sizeof(double) * count)) == NULL)
        return PyErr_NoMemory();
    if (arena == NULL) return NULL;
    Solution solution;
    PyObject *numbers = space_for(hierarchy, &box, &solution), *answer = NULL;
    if (numbers != NULL) {
        fill(hierarchy, box, box + n, arena);
        hierarchy->lower = box, hierarchy->upper = box + n;
        if (start != NULL) memcpy(solution.v, start, sizeof(double) * (size_t)n);
        if (!solve_hierarchy(hierarchy, guess, &solution, asks ? ask : NULL, args[2], arena)) {
            PyObject *v = copied(solution.v, n, -1), *told = NULL;
            if (names != NULL) told = summary(hierarchy, &solution, names);
            if (v != NULL && (told != NULL) == (names != NULL)) {
                PyArray_CLEARFLAGS((PyArrayObject *)v, NPY_ARRAY_WRITEABLE);
                PyArray_CLEARFLAGS((PyArrayObject *)numbers, NPY_ARRAY_WRITEABLE);
                answer = PyTuple_Pack(names == NULL ? 2 : 3, v, numbers, told);
            }
            Py_XDECREF(v);
            Py_XDECREF(told);
        }
        Py_DECREF(numbers);
    }
    PyMem_RawFree(own.memory);
    return answer;
}

static int check_levels(const Hierarchy *hierarchy, npy_intp rows)
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
        hierarchy->guarded <= hierarchy->levels)
        return 1;
    PyErr_SetString(PyExc_ValueError, "ends must rise to the number of rows, and guarded be at "
                                      "most the number of levels");
    return 0;
}

/* The box of a problem that is there already. */
static void copy_box(Hierarchy *hierarchy, double *lower, double *upper, Arena *arena)
{
    (void)arena;
    memcpy(lower, hierarchy->lower, sizeof(double) * (size_t)hierarchy->n);
    memcpy(upper, hierarchy->upper, sizeof(double) * (size_t)hierarchy->n);
}

/* solve(A, b, ends, damping, lower, upper, C, d, guarded, max_rounds, v, guess, backend) */
PyObject *solve(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    (void)self;
    if (!counted("solve", count, 13)) return NULL;
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
        count_of(args[9], MOST_ROUNDS, "max_rounds"),
    };
    if (PyErr_Occurred() || !check_levels(&hierarchy, rows)) return NULL;
    return answered(&hierarchy, copy_box, 0, args + 10, NULL);
}

/* The program's side of a cycle, from tasks and limits to a Hierarchy. */
typedef struct {
    Hierarchy hierarchy; /* first, so that make_rows() finds the rest */
    Cycle cycle;
    const double *tasks, *vectors, *limits;
    int task_count, limit_count;
    double period, braking; /* share of the joints' limits that tasks brake with; 0: never */
} Program;

static void make_rows(Hierarchy *hierarchy, double *lower, double *upper, Arena *arena)
{
    const Program *program = (const Program *)hierarchy;
    const Cycle *cycle = &program->cycle;
    const int n = hierarchy->n, rows = (int)hierarchy->ends[hierarchy->levels - 1];
    double *A = take(arena, rows * n), *b = take(arena, rows), *e = take(arena, rows);
    double *rate = take(arena, rows);
    double *C = take(arena, hierarchy->m * n), *d = take(arena, hierarchy->m);
    const Brakes brakes = {n, cycle->joints + 3 * n, cycle->joints + 4 * n, cycle->v, cycle->a,
                           program->braking, program->period};
    int at = 0, level = 0, first = 0;
    for (int k = 0; k < program->task_count; ++k) {
        const double *line = program->tasks + k * TASK_NUMBERS;
        const int m = rows_of_task(line, n);
        while (at >= hierarchy->ends[level]) first = (int)hierarchy->ends[level++];
        task_rows(cycle, line, program->vectors + 2 * k * n, A + at * n, b + at, e, arena);
        if (has_error(line)) {
            const Approached task = {m, first, A, A + at * n, e, b + at,
                                     line[2], hierarchy->damping[level]};
            approach_rate(&brakes, &task, rate, arena);
            for (int i = 0; i < m; ++i) b[at + i] += rate[i];
        }
        at += m;
    }
    memset(A + at * n, 0, sizeof(double) * (size_t)(n * n));
    for (int i = 0; i < n; ++i) {
        A[(at + i) * n + i] = 1.0, b[at + i] = 0.0;
        lower[i] = -INFINITY, upper[i] = INFINITY;
    }
    at = 0;
    for (int k = 0; k < program->limit_count; ++k) {
        const double *line = program->limits + k * LIMIT_NUMBERS;
        limit_rows(cycle, line, lower, upper, C + at * n, d + at);
        at += rows_of_limit(line);
    }
    hierarchy->A = A, hierarchy->b = b, hierarchy->C = C, hierarchy->d = d;
}

/* approached(above, A, e, carried, gain, damping, v, a, acceleration, jerk, braking): see
 * approach.h; braking is the period and the share. */
PyObject *approached(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    (void)self;
    if (!counted("approached", count, 11)) return NULL;
    const npy_intp n = size_of(args[6]), m = size_of(args[2]);
    const npy_intp above_rows = n > 0 ? size_of(args[0]) / n : 0;
    const Approached task = {
        (int)m,
        (int)above_rows,
        numbers_of(args[0], NPY_DOUBLE, above_rows * n, "above"),
        numbers_of(args[1], NPY_DOUBLE, m * n, "A"),
        numbers_of(args[2], NPY_DOUBLE, m, "e"),
        numbers_of(args[3], NPY_DOUBLE, m, "carried"),
        number_of(args[4]),
        number_of(args[5]),
    };
    const double *braking = numbers_of(args[10], NPY_DOUBLE, 2, "braking");
    const Brakes brakes = {
        (int)n,
        numbers_of(args[8], NPY_DOUBLE, n, "acceleration"),
        numbers_of(args[9], NPY_DOUBLE, n, "jerk"),
        numbers_of(args[6], NPY_DOUBLE, n, "v"),
        numbers_of(args[7], NPY_DOUBLE, n, "a"),
        braking == NULL ? 0.0 : braking[1],
        braking == NULL ? 1.0 : braking[0],
    };
    if (PyErr_Occurred()) return NULL;
    Arena *arena = scratch((size_t)(n * n + n + 8 * m));
    if (arena == NULL) return NULL;
    double *rate = take(arena, (int)m);
    approach_rate(&brakes, &task, rate, arena);
    return copied(rate, (int)m, -1);
}

/* step(tasks, vectors, ends, damping, limits, joints, braking, guarded, max_rounds, x, J_local,
 *      angles, v, a, x_d, x_d_dot, pivot, pivot_dot, guess, backend, names) */
PyObject *step(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    (void)self;
    if (!counted("step", count, 21)) return NULL;
    if (!PyTuple_Check(args[20]) || PyTuple_GET_SIZE(args[20]) != size_of(args[2]) + 3) {
        PyErr_SetString(PyExc_ValueError,
                        "names must be a tuple, three more than there are levels");
        return NULL;
    }
    const npy_intp n = size_of(args[11]);
    Program program = {0};
    Hierarchy *hierarchy = &program.hierarchy;
    program.tasks = numbers_of(args[0], NPY_DOUBLE, -1, "tasks");
    program.task_count = (int)(size_of(args[0]) / TASK_NUMBERS);
    program.vectors = numbers_of(args[1], NPY_DOUBLE, 2 * n * program.task_count, "vectors");
    program.limits = numbers_of(args[4], NPY_DOUBLE, -1, "limits");
    program.limit_count = (int)(size_of(args[4]) / LIMIT_NUMBERS);
    const double *braking = numbers_of(args[6], NPY_DOUBLE, 2, "braking");
    program.cycle = (Cycle){
        .n = (int)n,
        .x = numbers_of(args[9], NPY_DOUBLE, 8, "x"),
        .J = numbers_of(args[10], NPY_DOUBLE, 6 * n, "J_local"),
        .angles = numbers_of(args[11], NPY_DOUBLE, n, "angles"),
        .v = numbers_of(args[12], NPY_DOUBLE, n, "v"),
        .a = numbers_of(args[13], NPY_DOUBLE, n, "a"),
        .x_d = numbers_of(args[14], NPY_DOUBLE, 8, "x_d"),
        .x_d_dot = numbers_of(args[15], NPY_DOUBLE, 8, "x_d_dot"),
        .pivot = numbers_of(args[16], NPY_DOUBLE, 3, "pivot"),
        .pivot_dot = numbers_of(args[17], NPY_DOUBLE, 3, "pivot_dot"),
        .joints = numbers_of(args[5], NPY_DOUBLE, JOINT_NUMBERS * n, "joints"),
    };
    hierarchy->n = (int)n, hierarchy->levels = (int)size_of(args[2]);
    hierarchy->ends = numbers_of(args[2], NPY_INT64, -1, "ends");
    hierarchy->damping = numbers_of(args[3], NPY_DOUBLE, hierarchy->levels, "damping");
    hierarchy->guarded = count_of(args[7], 1000, "guarded");
    hierarchy->max_rounds = count_of(args[8], MOST_ROUNDS, "max_rounds");
    if (PyErr_Occurred()) return NULL;
    npy_intp rows = n;
    int known = 1;
    for (int k = 0; k < program.task_count; ++k) {
        const int more = rows_of_task(program.tasks + k * TASK_NUMBERS, (int)n);
        known = known && more >= 0;
        rows += more;
    }
    for (int k = 0; k < program.limit_count; ++k) {
        const int more = rows_of_limit(program.limits + k * LIMIT_NUMBERS);
        known = known && more >= 0;
        hierarchy->m += more;
    }
    if (!known) {
        PyErr_SetString(PyExc_ValueError, "a task or limit of an unknown kind");
        return NULL;
    }
    if (!check_levels(hierarchy, rows)) return NULL;
    see(&program.cycle);
    program.period = braking[0], program.braking = braking[1];
    const size_t more = (size_t)((rows + hierarchy->m + 24) * (n + 4) + 4 * n * n);
    PyObject *const rest[3] = {Py_None, args[18], args[19]};
    return answered(hierarchy, make_rows, more, rest, args[20]);
}
