/* Block: one task, limit or objective of the library, for Python; see _kernel.pyi. */

#define NO_IMPORT_ARRAY
#include "blocks.h"

#include <math.h>
#include <stddef.h>
#include <structmember.h>

static PyTypeObject *block_type;

int add_block_type(PyObject *module);

PyObject *paced(PyObject *self, PyObject *const *args, Py_ssize_t count);

#define DAMPER "gain deceleration jerk period "
#define SPHERE "centre velocity on_trocar reach first last "

/* What a kind is made of: numbers, and lines of numbers a joint. */
static const struct {
    const char *name, *numbers, *lines;
} kinds[KINDS] = {
    [RCM] = {"rcm", "period", ""},
    [TIP] = {"tip", "", ""},
    [AT_TROCAR] = {"at_trocar", "", ""},
    [DEPTH] = {"depth", "", ""},
    [ROLL] = {"roll", "", ""},
    [DIRECTION] = {"direction", "", ""},
    [POSE] = {"pose", "", ""},
    [ENTRY] = {"entry", "reach", ""},
    [ROTATION] = {"rotation", "", ""},
    [ORIENTATION] = {"orientation", "orientation", ""},
    [STILL] = {"still", "", ""},
    [POSTURE] = {"posture", "", "posture continuous"},
    [OBJECTIVE] = {"objective", "K_c c_d", ""},
    [JOINTS] = {"joints", "period",
                "lowest highest velocity acceleration jerk braking easing"},
    [TROCAR_CONE] = {"trocar_cone", DAMPER "half_angle axis lever", ""},
    [TROCAR_SPEED] = {"trocar_speed", "gain share period", "acceleration"},
    [TROCAR_DEPTH] = {"trocar_depth", DAMPER "last wrist bends shallowest deepest", ""},
    [KEEP_OUT] = {"keep_out", DAMPER SPHERE "wrist bends", ""},
    [KEEP_IN] = {"keep_in", DAMPER SPHERE "wrist bends", ""},
    [ENTRY_SPHERE] = {"entry_sphere", DAMPER SPHERE "wrist bends", ""},
    [SINGULARITY_PRODUCT] = {"singularity_product", "", "offsets"},
    [MANIPULABILITY] = {"manipulability", "", ""},
    [LEAST_SINGULAR_VALUE] = {"least_singular_value", "", ""},
    [JOINT_CENTRING] = {"joint_centring", "", "middle half_range"},
};

/* Where the numbers stand. */
static const struct {
    const char *name;
    size_t offset;
    int count;
} fields[] = {
    {"period", offsetof(Block, period), 1},
    {"orientation", offsetof(Block, orientation), 4},
    {"K_c", offsetof(Block, K_c), 1},
    {"c_d", offsetof(Block, c_d), 1},
    {"gain", offsetof(Block, gain), 1},
    {"deceleration", offsetof(Block, deceleration), 1},
    {"jerk", offsetof(Block, jerk), 1},
    {"share", offsetof(Block, share), 1},
    {"half_angle", offsetof(Block, half_angle), 1},
    {"axis", offsetof(Block, axis), 3},
    {"lever", offsetof(Block, lever), 1},
    {"shallowest", offsetof(Block, shallowest), 1},
    {"deepest", offsetof(Block, deepest), 1},
    {"centre", offsetof(Block, centre), 3},
    {"velocity", offsetof(Block, velocity), 3},
    {"on_trocar", offsetof(Block, on_trocar), 1},
    {"reach", offsetof(Block, reach), 1},
    {"first", offsetof(Block, first), 1},
    {"last", offsetof(Block, last), 1},
    {"bends", offsetof(Block, bends), 1},
    {"wrist", offsetof(Block, wrist), BEND_NUMBERS * MOST_BENDS},
};

/* The next word of a text, copied; where it ends, or NULL after the last. */
static const char *next_word(const char *text, char word[32])
{
    size_t size = 0;
    while (*text == ' ') ++text;
    while (*text != '\0' && *text != ' ') word[size++] = *text++;
    word[size] = '\0';
    return size > 0 ? text : NULL;
}

/* An option by its name: `count` numbers (-1: a vector of any size), or NULL with an error. */
static PyArrayObject *option_of(PyObject *options, const char *name, int count)
{
    PyObject *value = PyDict_GetItemString(options, name); /* borrowed */
    if (value == NULL) {
        PyErr_Format(PyExc_TypeError, "the option %s is missing", name);
        return NULL;
    }
    PyArrayObject *array = numbers_in(value);
    if (array == NULL) return NULL;
    const npy_intp size = PyArray_SIZE(array);
    const int fits = count == 1 ? size == 1 : PyArray_NDIM(array) == 1 && (count < 0 || size == count);
    if (fits) return array;
    PyErr_Format(PyExc_ValueError, "the option %s has %zd numbers", name, (Py_ssize_t)size);
    Py_DECREF(array);
    return NULL;
}

/* Numbers into the block; how many options were read, or -1. */
static int read_numbers(Block *block, const char *names, PyObject *options)
{
    char word[32];
    int found = 0;
    while ((names = next_word(names, word)) != NULL) {
        for (size_t i = 0; i < sizeof fields / sizeof *fields; ++i) {
            if (strcmp(fields[i].name, word) != 0) continue;
            PyArrayObject *array = option_of(options, word, fields[i].count);
            if (array == NULL) return -1;
            memcpy((char *)block + fields[i].offset, PyArray_DATA(array),
                   sizeof(double) * (size_t)fields[i].count);
            Py_DECREF(array);
            ++found;
        }
    }
    return found;
}

/* Lines of numbers, one a joint, into the block; how many, or -1. */
static int read_lines(Block *block, const char *names, PyObject *options)
{
    char word[32];
    int found = 0;
    while ((names = next_word(names, word)) != NULL) {
        PyArrayObject *array = option_of(options, word, block->vectors == NULL ? -1 : block->n);
        if (array == NULL) return -1;
        const size_t size = sizeof(double) * (size_t)PyArray_SIZE(array);
        if (block->vectors == NULL && size > 0) {
            block->n = (int)PyArray_SIZE(array);
            block->vectors = PyMem_Malloc(JOINT_NUMBERS * size);
        }
        if (block->vectors == NULL) {
            if (size > 0) PyErr_NoMemory();
            else PyErr_Format(PyExc_ValueError, "the option %s is empty", word);
            Py_DECREF(array);
            return -1;
        }
        memcpy(block->vectors + (size_t)found * (size_t)block->n, PyArray_DATA(array), size);
        Py_DECREF(array);
        ++found;
    }
    return found;
}

static int read_objective(BlockObject *self, PyObject *options)
{
    PyObject *given = PyDict_GetItemString(options, "objective"); /* borrowed */
    if (given == NULL || !is_block(given) ||
        ((BlockObject *)given)->block.kind < FIRST_OBJECTIVE) {
        PyErr_SetString(PyExc_TypeError, "the option objective must be the Block of one");
        return -1;
    }
    self->objective = Py_NewRef(given);
    self->block.objective = &((BlockObject *)given)->block;
    self->block.n = self->block.objective->n;
    return 1;
}

static int fill_block(BlockObject *self)
{
    Block *block = &self->block;
    const char *name = PyUnicode_AsUTF8(self->kind);
    if (name == NULL) return -1;
    block->kind = KINDS;
    for (int k = 0; k < KINDS; ++k)
        if (strcmp(kinds[k].name, name) == 0) block->kind = (Kind)k;
    if (block->kind == KINDS) {
        PyErr_Format(PyExc_ValueError, "a block of an unknown kind, %s", name);
        return -1;
    }
    const int numbers = read_numbers(block, kinds[block->kind].numbers, self->options);
    const int lines = numbers < 0 ? -1 : read_lines(block, kinds[block->kind].lines, self->options);
    int more = 0;
    if (lines >= 0 && block->kind == OBJECTIVE) more = read_objective(self, self->options);
    if (lines < 0 || more < 0) return -1;
    if (numbers + lines + more != PyDict_Size(self->options)) {
        PyErr_Format(PyExc_TypeError, "unknown options for a block of the kind %s", name);
        return -1;
    }
    if (!(block->bends >= 0.0 && block->bends <= MOST_BENDS)) {
        PyErr_Format(PyExc_ValueError, "a wrist has %d joints at most", MOST_BENDS);
        return -1;
    }
    if (block->kind == SINGULARITY_PRODUCT && block->n != 7) {
        PyErr_SetString(PyExc_ValueError, "the option offsets must have 7 numbers");
        return -1;
    }
    return 0;
}

/* Block(kind, **options) */
static PyObject *block_new(PyTypeObject *type, PyObject *args, PyObject *options)
{
    PyObject *kind;
    if (!PyArg_ParseTuple(args, "U:Block", &kind)) return NULL;
    BlockObject *self = (BlockObject *)type->tp_alloc(type, 0);
    if (self == NULL) return NULL;
    self->kind = Py_NewRef(kind);
    self->options = options == NULL ? PyDict_New() : PyDict_Copy(options);
    if (self->options == NULL || fill_block(self) < 0) Py_CLEAR(self);
    return (PyObject *)self;
}

static void block_dealloc(BlockObject *self)
{
    PyTypeObject *type = Py_TYPE(self);
    PyMem_Free(self->block.vectors);
    Py_XDECREF(self->kind);
    Py_XDECREF(self->options);
    Py_XDECREF(self->objective);
    type->tp_free(self);
    Py_DECREF(type);
}

int is_block(PyObject *object) { return Py_IS_TYPE(object, block_type); }

/* A cycle out of its arguments, as compiled code reads them; 0 with a Python error. The last is
 * ArmState.tool_at: where the tip is, and pose and Jacobian of a tool with a wrist. */
int read_cycle(PyObject *const *args, Cycle *cycle)
{
    const npy_intp n = size_of(args[2]);
    *cycle = (Cycle){
        .n = (int)n,
        .x = numbers_of(args[0], NPY_DOUBLE, 8, "x"),
        .J = numbers_of(args[1], NPY_DOUBLE, 6 * n, "J_local"),
        .angles = numbers_of(args[2], NPY_DOUBLE, n, "angles"),
        .v = numbers_of(args[3], NPY_DOUBLE, n, "v"),
        .a = numbers_of(args[4], NPY_DOUBLE, n, "a"),
        .x_d = numbers_of(args[5], NPY_DOUBLE, 8, "x_d"),
        .x_d_dot = numbers_of(args[6], NPY_DOUBLE, 8, "x_d_dot"),
        .pivot = numbers_of(args[7], NPY_DOUBLE, 3, "pivot"),
        .pivot_dot = numbers_of(args[8], NPY_DOUBLE, 3, "pivot_dot"),
    };
    PyObject *tool = args[CYCLE_ARRAYS];
    const Py_ssize_t parts = PyTuple_Check(tool) ? PyTuple_GET_SIZE(tool) : 0;
    if (parts == 3) {
        cycle->x_t = numbers_of(PyTuple_GET_ITEM(tool, 1), NPY_DOUBLE, 8, "x_t");
        cycle->J_t = numbers_of(PyTuple_GET_ITEM(tool, 2), NPY_DOUBLE, 6 * n, "J_t");
    }
    if (PyErr_Occurred()) return 0;
    if ((parts != 1 && parts != 3) || !PyFloat_Check(PyTuple_GET_ITEM(tool, 0))) {
        PyErr_SetString(PyExc_TypeError, "tool_at must be (tip,) or (tip, x, J_local)");
        return 0;
    }
    cycle->tip = PyFloat_AS_DOUBLE(PyTuple_GET_ITEM(tool, 0));
    see(cycle);
    return 1;
}

/* Rows of a block at a cycle: of a task, or of a limit; with a gain, of a task as goal() gives them. */
static PyObject *rows_at(const Block *block, const Cycle *cycle, const double *gain)
{
    const int n = cycle->n, m = rows_of(block, n);
    if (m < 0) {
        PyErr_Format(PyExc_ValueError, "the block is for %d joints, the arm has %d", block->n, n);
        return NULL;
    }
    if (block->bends > 0.0 && cycle->x_t == NULL) {
        PyErr_SetString(PyExc_ValueError, "the block is for a wrist, the arm has none");
        return NULL;
    }
    const size_t size = (size_t)(m * (n + 2) + 2 * n) + memory_for_objective(n);
    Arena arena = {PyMem_Malloc(sizeof(double) * size), 0};
    if (arena.memory == NULL) return PyErr_NoMemory();
    double *A = take(&arena, m * n), *b = take(&arena, m), *e = take(&arena, m);
    double *lower = take(&arena, n), *upper = take(&arena, n);
    PyObject *rows;
    if (block->kind < FIRST_LIMIT) {
        task_rows(cycle, block, A, b, e, &arena);
        for (int i = 0; i < m; ++i) b[i] = gain == NULL ? -b[i] : b[i] - *gain * e[i];
        if (gain != NULL) rows = Py_BuildValue("(NN)", copied(A, m, n), copied(b, m, -1));
        else rows = Py_BuildValue("(NNN)", copied(e, m, -1), copied(A, m, n), copied(b, m, -1));
    } else {
        for (int i = 0; i < n; ++i) lower[i] = -INFINITY, upper[i] = INFINITY;
        limit_rows(cycle, block, lower, upper, A, b, &arena);
        rows = Py_BuildValue("(NNNN)", copied(lower, n, -1), copied(upper, n, -1), copied(A, m, n),
                             copied(b, m, -1));
    }
    PyMem_Free(arena.memory);
    return rows;
}

/* rows(x, J_local, angles, v, a, x_d, x_d_dot, pivot, pivot_dot, tool) of a task: error, jacobian,
 * drift; of a limit: lower, upper, C, d. Anything that numpy reads as numbers is welcome. */
static PyObject *block_rows(BlockObject *self, PyObject *const *args, Py_ssize_t count)
{
    if (!counted("rows", count, CYCLE_ARGUMENTS)) return NULL;
    if (self->block.kind >= FIRST_OBJECTIVE) {
        PyErr_SetString(PyExc_TypeError, "an objective has no rows, but a value");
        return NULL;
    }
    PyObject *arrays[CYCLE_ARGUMENTS] = {[CYCLE_ARRAYS] = args[CYCLE_ARRAYS]}, *rows = NULL;
    Cycle cycle;
    int read = 0;
    while (read < CYCLE_ARRAYS && (arrays[read] = (PyObject *)numbers_in(args[read])) != NULL)
        ++read;
    if (read == CYCLE_ARRAYS && read_cycle(arrays, &cycle)) rows = rows_at(&self->block, &cycle, NULL);
    for (int i = 0; i < read; ++i) Py_DECREF(arrays[i]);
    return rows;
}

/* goal(cycle ..., gain) of a task: A and b of A v = b, which reduces the error at the gain. */
static PyObject *block_goal(BlockObject *self, PyObject *const *args, Py_ssize_t count)
{
    Cycle cycle;
    if (!counted("goal", count, CYCLE_ARGUMENTS + 1)) return NULL;
    if (self->block.kind >= FIRST_LIMIT) {
        PyErr_SetString(PyExc_TypeError, "only a task has a goal");
        return NULL;
    }
    const double gain = number_of(args[CYCLE_ARGUMENTS]);
    return read_cycle(args, &cycle) ? rows_at(&self->block, &cycle, &gain) : NULL;
}

/* value(J_local, angles) of an objective: c and its gradient. */
static PyObject *block_value(BlockObject *self, PyObject *const *args, Py_ssize_t count)
{
    if (!counted("value", count, 2)) return NULL;
    if (self->block.kind < FIRST_OBJECTIVE) {
        PyErr_SetString(PyExc_TypeError, "only an objective has a value");
        return NULL;
    }
    npy_intp n = size_of(args[1]);
    const double *J = numbers_of(args[0], NPY_DOUBLE, 6 * n, "J_local");
    const double *angles = numbers_of(args[1], NPY_DOUBLE, n, "angles");
    if (!PyErr_Occurred() && rows_of(&self->block, (int)n) < 0)
        PyErr_Format(PyExc_ValueError, "the objective is for %d joints, the arm has %zd",
                     self->block.n, (Py_ssize_t)n);
    if (PyErr_Occurred()) return NULL;
    PyObject *gradient = PyArray_SimpleNew(1, &n, NPY_DOUBLE), *value = NULL;
    Arena arena = {PyMem_Malloc(sizeof(double) * memory_for_objective((int)n)), 0};
    if (gradient != NULL && arena.memory != NULL) {
        const double c = objective_value(&self->block, J, angles, (int)n,
                                         PyArray_DATA((PyArrayObject *)gradient), &arena);
        value = Py_BuildValue("(dO)", c, gradient);
    } else if (gradient != NULL) {
        PyErr_NoMemory();
    }
    PyMem_Free(arena.memory);
    Py_XDECREF(gradient);
    return value;
}

/* interval(angles, v, a) of JOINTS: the box, lower and upper (n). */
static PyObject *block_interval(BlockObject *self, PyObject *const *args, Py_ssize_t count)
{
    if (!counted("interval", count, 3)) return NULL;
    const int n = self->block.n;
    npy_intp size = n;
    PyArrayObject *arrays[3] = {NULL};
    int read = 0;
    while (read < 3 && (arrays[read] = numbers_in(args[read])) != NULL) ++read;
    PyObject *low = NULL, *up = NULL;
    if (read == 3 && self->block.kind == JOINTS && is_vector(arrays[0], n) &&
        is_vector(arrays[1], n) && is_vector(arrays[2], n)) {
        low = PyArray_SimpleNew(1, &size, NPY_DOUBLE), up = PyArray_SimpleNew(1, &size, NPY_DOUBLE);
    } else if (read == 3) {
        PyErr_Format(PyExc_ValueError, "interval() is for joint limits and %d joints", n);
    }
    if (low != NULL && up != NULL) {
        const Cycle cycle = {.n = n,
                             .angles = PyArray_DATA(arrays[0]),
                             .v = PyArray_DATA(arrays[1]),
                             .a = PyArray_DATA(arrays[2])};
        double *lower = PyArray_DATA((PyArrayObject *)low);
        double *upper = PyArray_DATA((PyArrayObject *)up);
        for (int i = 0; i < n; ++i) lower[i] = -INFINITY, upper[i] = INFINITY;
        limit_rows(&cycle, &self->block, lower, upper, NULL, NULL, NULL);
    }
    for (int i = 0; i < read; ++i) Py_DECREF(arrays[i]);
    return Py_BuildValue("(NN)", low, up);
}

/* paced(gain, deceleration, s) */
PyObject *paced(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    (void)self;
    if (!counted("paced", count, 3)) return NULL;
    const double gain = number_of(args[0]), deceleration = number_of(args[1]);
    const double s = number_of(args[2]);
    return PyErr_Occurred() ? NULL : PyFloat_FromDouble(pace(gain, deceleration, s));
}

static PyMethodDef methods[] = {
    {"rows", (PyCFunction)(void (*)(void))block_rows, METH_FASTCALL,
     "Rows of a task or a limit at a state and a reference."},
    {"goal", (PyCFunction)(void (*)(void))block_goal, METH_FASTCALL,
     "What a task asks of the joint velocity at a gain."},
    {"interval", (PyCFunction)(void (*)(void))block_interval, METH_FASTCALL,
     "The box of joint limits."},
    {"value", (PyCFunction)(void (*)(void))block_value, METH_FASTCALL,
     "Value and gradient of an objective."},
    {NULL, NULL, 0, NULL},
};

static PyMemberDef members[] = {
    {"joints", T_INT, offsetof(BlockObject, block) + offsetof(Block, n), READONLY,
     "Joints that it is for; 0 for any arm."},
    {"bends", T_DOUBLE, offsetof(BlockObject, block) + offsetof(Block, bends), READONLY,
     "Joints of the wrist that it is for; 0 without one."},
    {NULL, 0, 0, 0, NULL},
};

static PyType_Slot slots[] = {
    {Py_tp_new, block_new},
    {Py_tp_dealloc, block_dealloc},
    {Py_tp_methods, methods},
    {Py_tp_members, members},
    {Py_tp_doc, "One task, limit or objective, made of its options."},
    {0, NULL},
};

static PyType_Spec spec = {"rcmqp._kernel.Block", sizeof(BlockObject), 0, Py_TPFLAGS_DEFAULT,
                           slots};

int add_block_type(PyObject *module)
{
    block_type = (PyTypeObject *)PyType_FromSpec(&spec);
    return block_type == NULL ? -1 : PyModule_AddType(module, block_type);
}
