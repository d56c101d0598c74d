/* Stack: levels of tasks below limits, for Python; see _kernel.pyi.
 *
 * A step calls nothing of Python but a backend; meanwhile the stack refuses a second step. */

#define NO_IMPORT_ARRAY
#include "blocks.h"
#include "given.h"

#include <math.h>

typedef struct {
    PyObject_HEAD
    Stack stack;
    PyObject *blocks, *names, *ends; /* kept alive; names of the numbers in a summary */
    double *numbers;  /* damping, acceleration, jerk */
    double *sets;     /* (levels + 1, SETS, bounds) active sets found last */
    Room rooms[2];    /* used in turns, so that one account may wait while the next is made */
    int turn, guarded, max_rounds, bounds, busy;
} StackObject;

int add_stack_type(PyObject *module);

/* A member of a level or a limit: its block, kept alive, or NULL for None; -1 with an error. */
static int read_block(StackObject *self, PyObject *given, Kind first, Kind end, const Block **block)
{
    if (given == Py_None) return 0;
    if (!is_block(given) || ((BlockObject *)given)->block.kind < first ||
        ((BlockObject *)given)->block.kind >= end) {
        PyErr_SetString(PyExc_TypeError, "tasks and limits of a stack are Blocks of theirs, or None");
        return -1;
    }
    *block = &((BlockObject *)given)->block;
    if (rows_of(*block, self->stack.n) < 0) {
        PyErr_Format(PyExc_ValueError, "a task or limit is not for an arm of %d joints",
                     self->stack.n);
        return -1;
    }
    return PyList_Append(self->blocks, given);
}

static int is_tuple(PyObject *object)
{
    if (PyTuple_Check(object)) return 1;
    PyErr_SetString(PyExc_TypeError, "levels are tuples (damping, tasks), tasks (block, gain, root)");
    return 0;
}

static int read_tasks(StackObject *self, PyObject *levels)
{
    Stack *stack = &self->stack;
    int count = 0;
    for (Py_ssize_t k = 0; k < PyTuple_GET_SIZE(levels); ++k) {
        PyObject *level = PyTuple_GET_ITEM(levels, k), *tasks;
        if (!is_tuple(level) ||
            !PyArg_ParseTuple(level, "dO!", self->numbers + k, &PyTuple_Type, &tasks))
            return -1;
        for (Py_ssize_t i = 0; i < PyTuple_GET_SIZE(tasks); ++i) {
            StackTask task = {.level = (int)k};
            PyObject *given, *member = PyTuple_GET_ITEM(tasks, i);
            if (!is_tuple(member) ||
                !PyArg_ParseTuple(member, "Odd", &given, &task.gain, &task.root) ||
                read_block(self, given, RCM, FIRST_LIMIT, &task.block) < 0)
                return -1;
            StackTask *more = PyMem_Resize(stack->tasks, StackTask, (size_t)count + 1);
            if (more == NULL) return PyErr_NoMemory(), -1;
            stack->tasks = more, stack->tasks[count++] = task;
            stack->task_count = count;
        }
    }
    return 0;
}

static int read_limits(StackObject *self, PyObject *limits)
{
    Stack *stack = &self->stack;
    const size_t count = (size_t)PyTuple_GET_SIZE(limits);
    if ((stack->limits = PyMem_Calloc(count + 1, sizeof(StackLimit))) == NULL)
        return PyErr_NoMemory(), -1;
    stack->limit_count = (int)count;
    for (size_t k = 0; k < count; ++k)
        if (read_block(self, PyTuple_GET_ITEM(limits, k), FIRST_LIMIT, FIRST_OBJECTIVE,
                       &stack->limits[k].block) < 0)
            return -1;
    return 0;
}

/* What tasks brake with: the smallest of the acceleration and jerk limits of the JOINTS, if any. */
static void read_abilities(Stack *stack, double *acceleration, double *jerk)
{
    int boxes = 0;
    for (int k = 0; k < stack->limit_count; ++k) {
        const Block *block = stack->limits[k].block;
        if (block == NULL || block->kind != JOINTS) continue;
        for (int i = 0; i < stack->n; ++i) {
            const double a = block->vectors[ACCELERATION * stack->n + i];
            const double j = block->vectors[JERK * stack->n + i];
            acceleration[i] = boxes ? smaller(acceleration[i], a) : a;
            jerk[i] = boxes ? smaller(jerk[i], j) : j;
        }
        ++boxes;
    }
    stack->acceleration = acceleration, stack->jerk = jerk;
}

/* Stack(levels, limits, acceleration, jerk, share, period, guarded, max_rounds, names) */
static PyObject *stack_new(PyTypeObject *type, PyObject *args, PyObject *options)
{
    static char *known[] = {"levels", "limits", "acceleration", "jerk", "share", "period",
                            "guarded", "max_rounds", "names", NULL};
    PyObject *levels, *limits, *acceleration, *jerk, *names;
    double share, period;
    int guarded, max_rounds;
    if (!PyArg_ParseTupleAndKeywords(args, options, "$O!O!OOddiiO!:Stack", known, &PyTuple_Type,
                                     &levels, &PyTuple_Type, &limits, &acceleration, &jerk, &share,
                                     &period, &guarded, &max_rounds, &PyTuple_Type, &names))
        return NULL;
    const npy_intp n = size_of(acceleration);
    const double *a = numbers_of(acceleration, NPY_DOUBLE, n, "acceleration");
    const double *j = numbers_of(jerk, NPY_DOUBLE, n, "jerk");
    if (PyErr_Occurred()) return NULL;
    StackObject *self = (StackObject *)type->tp_alloc(type, 0);
    if (self == NULL) return NULL;
    Stack *stack = &self->stack;
    const size_t count = (size_t)PyTuple_GET_SIZE(levels) + 1;
    npy_intp size = (npy_intp)count;
    stack->n = (int)n, stack->levels = (int)count, stack->share = share, stack->period = period;
    self->guarded = guarded, self->max_rounds = max_rounds, self->bounds = -1;
    self->names = Py_NewRef(names), self->blocks = PyList_New(0);
    self->ends = PyArray_ZEROS(1, &size, NPY_INT64, 0);
    self->numbers = PyMem_Calloc(count + 2 * (size_t)n, sizeof(double));
    if (self->numbers == NULL) PyErr_NoMemory();
    if (PyTuple_GET_SIZE(names) != size + 3 || guarded < 0 || guarded >= size || max_rounds < 1 ||
        n < 1)
        PyErr_SetString(PyExc_ValueError, "names must be four more than there are levels, guarded "
                                          "at most as many, max_rounds positive, and a joint there");
    if (!PyErr_Occurred()) { /* before a task's number calls Python */
        memcpy(self->numbers + count, a, sizeof(double) * (size_t)n);
        memcpy(self->numbers + count + n, j, sizeof(double) * (size_t)n);
    }
    if (PyErr_Occurred() || read_tasks(self, levels) < 0 || read_limits(self, limits) < 0) {
        Py_DECREF(self);
        return NULL;
    }
    stack->damping = self->numbers;
    read_abilities(stack, self->numbers + count, self->numbers + count + n);
    return (PyObject *)self;
}

static void stack_dealloc(StackObject *self)
{
    PyTypeObject *type = Py_TYPE(self);
    PyMem_Free(self->stack.tasks);
    PyMem_Free(self->stack.limits);
    PyMem_Free(self->numbers);
    PyMem_Free(self->sets);
    for (int k = 0; k < 2; ++k) PyMem_RawFree(self->rooms[k].memory);
    Py_XDECREF(self->blocks);
    Py_XDECREF(self->names);
    Py_XDECREF(self->ends);
    type->tp_free(self);
    Py_DECREF(type);
}

/* Where the levels end; in a new array where that is not as before, for the old one was handed
 * out. */
static int end_levels(StackObject *self)
{
    const Stack *stack = &self->stack;
    int64_t *ends = PyArray_DATA((PyArrayObject *)self->ends), total = 0;
    for (int k = 0, level = 0; level < stack->levels; ++level) {
        for (; k < stack->task_count && stack->tasks[k].level == level; ++k)
            total += stack->tasks[k].m;
        if (level == stack->levels - 1) total += stack->n;
        if (ends[level] == total) continue;
        PyObject *made = PyArray_NewCopy((PyArrayObject *)self->ends, NPY_CORDER);
        if (made == NULL) return -1;
        ends = PyArray_DATA((PyArrayObject *)made), ends[level] = total;
        PyArray_CLEARFLAGS((PyArrayObject *)made, NPY_ARRAY_WRITEABLE);
        Py_SETREF(self->ends, made);
    }
    return 0;
}

/* Memory for a cycle in the room whose turn it is, and active sets of the right size; -1 with an
 * error. */
static int make_room(StackObject *self, const Hierarchy *hierarchy, npy_intp rows)
{
    const int n = hierarchy->n, m = hierarchy->m, levels = hierarchy->levels;
    const size_t size = memory_for_rows(n, m, (int)rows) + memory_for(n, m, (int)rows, levels);
    Room *room = &self->rooms[self->turn];
    if (finish_account(room) < 0) return -1;
    if (size > room->capacity) {
        double *memory = PyMem_RawRealloc(room->memory, sizeof(double) * size);
        if (memory == NULL) return PyErr_NoMemory(), -1;
        room->memory = memory, room->capacity = size;
    }
    if (self->bounds == n + m) return 0;
    double *sets = PyMem_Calloc((size_t)(levels + 1) * SETS * (size_t)(n + m), sizeof(double));
    if (sets == NULL) return PyErr_NoMemory(), -1;
    PyMem_Free(self->sets);
    self->sets = sets, self->bounds = n + m;
    return 0;
}

/* Whether a joint's acceleration is limited. */
static int is_sluggish(const Stack *stack)
{
    for (int i = 0; i < stack->n; ++i)
        if (stack->acceleration[i] < INFINITY) return 1;
    return 0;
}

/* The problem of a cycle: 1, with the arena after it; 0 where given rows are not usable; -1. */
static int read_problem(StackObject *self, PyObject *const *args, Hierarchy *hierarchy,
                        Arena *arena)
{
    Stack *stack = &self->stack;
    Cycle cycle;
    if (!PyList_Check(args[CYCLE_ARGUMENTS])) {
        PyErr_SetString(PyExc_TypeError, "the rows that are given must be a list");
        return -1;
    }
    const int fit = read_given(stack, args[CYCLE_ARGUMENTS]);
    if (fit <= 0) return fit;
    if (!read_cycle(args, &cycle) || end_levels(self) < 0) return -1;
    if (cycle.n != stack->n) {
        PyErr_Format(PyExc_ValueError, "a state of %d joints for %d", cycle.n, stack->n);
        return -1;
    }
    *hierarchy = (Hierarchy){
        .n = stack->n, .levels = stack->levels, .damping = stack->damping,
        .ends = PyArray_DATA((PyArrayObject *)self->ends),
        .guarded = self->guarded, .sluggish = is_sluggish(stack), .max_rounds = self->max_rounds,
    };
    for (int k = 0; k < stack->limit_count; ++k) hierarchy->m += stack->limits[k].m;
    const npy_intp rows = (npy_intp)hierarchy->ends[stack->levels - 1];
    if (!check_levels(hierarchy, rows) || make_room(self, hierarchy, rows) < 0) return -1;
    *arena = (Arena){self->rooms[self->turn].memory, 0};
    int64_t *ends = (int64_t *)take(arena, stack->levels); /* those of an account stay its own */
    memcpy(ends, hierarchy->ends, sizeof(int64_t) * (size_t)stack->levels);
    hierarchy->ends = ends;
    stack_rows(stack, &cycle, hierarchy, arena);
    return 1;
}

static int enter(StackObject *self)
{
    if (self->busy) {
        PyErr_SetString(PyExc_RuntimeError, "a step of this controller is going on; give each "
                                            "thread a controller of its own");
        return 0;
    }
    return self->busy = 1;
}

/* step(cycle ..., given, backend): v, account, ends, hard rows; None where rows that are given do not
 * fit or are not finite. */
static PyObject *stack_step(StackObject *self, PyObject *const *args, Py_ssize_t count)
{
    if (!counted("step", count, CYCLE_ARGUMENTS + 2) || !enter(self)) return NULL;
    PyObject *v = NULL, *account = NULL, *whole = NULL;
    Solved solved;
    Arena arena;
    self->turn = !self->turn;
    const int read = read_problem(self, args, &solved.hierarchy, &arena);
    if (read > 0 && !solve_in(&solved, NULL, self->sets, args[CYCLE_ARGUMENTS + 1], &arena)) {
        v = copied(solved.solution.v, solved.hierarchy.n, -1);
        account = make_account(&solved, arena, &self->rooms[self->turn], (PyObject *)self,
                               self->names);
    }
    PyObject *m = account == NULL ? NULL : PyLong_FromLong(solved.hierarchy.m);
    if (v != NULL && m != NULL) whole = PyTuple_Pack(4, v, account, self->ends, m);
    Py_XDECREF(v);
    Py_XDECREF(account);
    Py_XDECREF(m);
    self->busy = 0;
    return read == 0 ? Py_NewRef(Py_None) : whole;
}

/* problem(cycle ..., given): A, b, ends, lower, upper, C, d as step() would solve it, or None. */
static PyObject *stack_problem(StackObject *self, PyObject *const *args, Py_ssize_t count)
{
    if (!counted("problem", count, CYCLE_ARGUMENTS + 1) || !enter(self)) return NULL;
    PyObject *problem = NULL;
    Hierarchy found;
    Arena arena;
    const int read = read_problem(self, args, &found, &arena);
    if (read > 0) {
        const int rows = (int)found.ends[found.levels - 1], n = found.n, m = found.m;
        problem = Py_BuildValue("(NNONNNN)", copied(found.A, rows, n), copied(found.b, rows, -1),
                                self->ends, copied(found.lower, n, -1), copied(found.upper, n, -1),
                                copied(found.C, m, n), copied(found.d, m, -1));
    }
    self->busy = 0;
    return read == 0 ? Py_NewRef(Py_None) : problem;
}

/* reset(): forget the active sets found last. */
static PyObject *stack_reset(StackObject *self, PyObject *Py_UNUSED(none))
{
    if (!enter(self)) return NULL;
    self->bounds = -1, self->busy = 0;
    Py_RETURN_NONE;
}

static PyMethodDef methods[] = {
    {"step", (PyCFunction)(void (*)(void))stack_step, METH_FASTCALL,
     "The lexicographic optimum of a cycle."},
    {"problem", (PyCFunction)(void (*)(void))stack_problem, METH_FASTCALL,
     "The rows of a cycle, as step() solves them."},
    {"reset", (PyCFunction)stack_reset, METH_NOARGS, "Forget the warm start."},
    {NULL, NULL, 0, NULL},
};

static PyType_Slot slots[] = {
    {Py_tp_new, stack_new},
    {Py_tp_dealloc, stack_dealloc},
    {Py_tp_methods, methods},
    {Py_tp_doc, "Levels of tasks below limits, stepped cycle by cycle."},
    {0, NULL},
};

static PyType_Spec spec = {"rcmqp._kernel.Stack", sizeof(StackObject), 0, Py_TPFLAGS_DEFAULT,
                           slots};

int add_stack_type(PyObject *module)
{
    PyObject *type = PyType_FromSpec(&spec);
    if (type == NULL) return -1;
    const int failed = PyModule_AddType(module, (PyTypeObject *)type);
    Py_DECREF(type);
    return failed;
}
