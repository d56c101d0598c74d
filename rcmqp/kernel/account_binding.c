/* Account: the numbers of a solve, made when they are asked for; see _kernel.pyi.
 *
 * Until then, what they are made of is in a room of the stack. Before the stack uses the room again, it
 * finishes the account there, unless nobody has the account any more. */

#define NO_IMPORT_ARRAY
#include "blocks.h"

struct Account {
    PyObject_HEAD
    Solved solved;
    Arena arena;
    Room *room;      /* where that is; NULL once the account is made */
    PyObject *owner; /* of the room, kept alive */
    PyObject *names; /* of the numbers in the summary; NULL for none */
    PyObject *numbers, *summary; /* NULL until then */
    int busy;
};

int add_account_type(PyObject *module);

static PyTypeObject *account_type;

/* found[names[i]] = number; 0, or 1 with a Python error */
static int put(PyObject *found, PyObject *names, int i, double number)
{
    PyObject *value = PyFloat_FromDouble(number);
    const int failed =
        value == NULL || PyDict_SetItem(found, PyTuple_GET_ITEM(names, i), value) < 0;
    Py_XDECREF(value);
    return failed;
}

/* Fill in what a run records of a solve, by `names` (levels + 3): the norm of each level's residual
 * but the rest's; whether all is exact; joints at a bound; the largest excess of a hard row; the
 * largest KKT residual. HierarchySolution.summary is the same in Python. Returns -1 with an error. */
static int summarise(const Hierarchy *hierarchy, const Solution *solution, PyObject *names,
                     PyObject *summary)
{
    const int n = hierarchy->n, N = n + hierarchy->m, levels = hierarchy->levels;
    int exact = 1, bounded = 0, first = 0, failed = 0;
    double excess = 0.0, kkt = 0.0;
    for (int k = 0; k <= levels; ++k) {
        if (!(solution->info[k * COLUMNS + ROUTE] < UNVERIFIED)) exact = 0;
        if (k > 0 && !(solution->info[k * COLUMNS + KKT] <= kkt))
            kkt = solution->info[k * COLUMNS + KKT];
        if (k == 0 || k == levels) continue;
        const int last = (int)hierarchy->ends[k - 1];
        failed |= put(summary, names, k - 1, norm_of(solution->residual + first, last - first));
        first = last;
    }
    for (int i = 0; i < n; ++i)
        if (solution->touching[i] > 0.0 || solution->touching[N + i] > 0.0) ++bounded;
    for (int i = 0; i < hierarchy->m; ++i) excess = larger(excess, solution->violation[i]);
    failed |= put(summary, names, levels - 1, exact);
    failed |= put(summary, names, levels, bounded);
    failed |= put(summary, names, levels + 1, excess);
    failed |= put(summary, names, levels + 2, kkt);
    return failed ? -1 : 0;
}

/* Nothing of it stands in the room any more. */
static void leave(Account *self)
{
    if (self->room != NULL) self->room->account = NULL;
    self->room = NULL;
    Py_CLEAR(self->owner);
}

/* Make the account, if it is not made; -1 with a Python error.
 *
 * A new dictionary may start the garbage collector, and that Python code which asks for this account:
 * so it comes first. Later only a name's own __hash__ could. */
static int make(Account *self)
{
    const Solved *solved = &self->solved;
    PyObject *summary = self->names == NULL ? Py_NewRef(Py_None) : PyDict_New();
    if (self->numbers != NULL || summary == NULL || self->busy) {
        if (self->busy) PyErr_SetString(PyExc_RuntimeError, "this account is being made");
        Py_XDECREF(summary);
        return self->numbers != NULL ? 0 : -1;
    }
    self->busy = 1;
    account(&solved->hierarchy, &self->solved.solution, &self->arena);
    PyObject *numbers = copied(solved->numbers, solved->size, -1);
    if (numbers != NULL && self->names != NULL &&
        summarise(&solved->hierarchy, &solved->solution, self->names, summary) < 0)
        Py_CLEAR(numbers);
    leave(self); /* what account() has scaled cannot be accounted for again */
    self->busy = 0;
    if (numbers == NULL) {
        Py_DECREF(summary);
        return -1;
    }
    self->numbers = numbers, self->summary = summary;
    return 0;
}

/* The account of a solve, still to be made where there is a room; or NULL with a Python error. */
PyObject *make_account(const Solved *solved, Arena arena, Room *room, PyObject *owner,
                       PyObject *names)
{
    Account *self = (Account *)account_type->tp_alloc(account_type, 0);
    if (self == NULL) return NULL;
    self->solved = *solved, self->arena = arena, self->room = room;
    self->owner = Py_XNewRef(owner), self->names = Py_XNewRef(names);
    if (room != NULL) {
        room->account = self;
    } else if (make(self) < 0) {
        Py_DECREF(self);
        return NULL;
    }
    return (PyObject *)self;
}

/* Make the account in a room, if there is one, before the room is used again; -1 with an error. */
int finish_account(Room *room)
{
    Account *self = room->account;
    if (self == NULL) return 0;
    Py_INCREF(self);
    const int made = make(self);
    Py_DECREF(self);
    return made;
}

/* One of its two parts. */
static PyObject *part_of(Account *self, PyObject *const *part)
{
    if (self->room != NULL && make(self) < 0) return NULL;
    if (*part == NULL) PyErr_SetString(PyExc_RuntimeError, "this account could not be made");
    return Py_XNewRef(*part);
}

static PyObject *get_numbers(Account *self, void *unused)
{
    (void)unused;
    return part_of(self, &self->numbers);
}

static PyObject *get_summary(Account *self, void *unused)
{
    (void)unused;
    return part_of(self, &self->summary);
}

static void account_dealloc(Account *self)
{
    PyTypeObject *type = Py_TYPE(self);
    leave(self);
    Py_XDECREF(self->names);
    Py_XDECREF(self->numbers);
    Py_XDECREF(self->summary);
    type->tp_free(self);
    Py_DECREF(type);
}

static PyGetSetDef getters[] = {
    {"numbers", (getter)get_numbers, NULL, "All numbers of an Answer, in its order.", NULL},
    {"summary", (getter)get_summary, NULL, "What a run records of the solve, or None.", NULL},
    {NULL, NULL, NULL, NULL, NULL},
};

static PyType_Slot slots[] = {
    {Py_tp_dealloc, account_dealloc},
    {Py_tp_getset, getters},
    {Py_tp_doc, "The numbers of a solve, made when they are asked for."},
    {0, NULL},
};

static PyType_Spec spec = {"rcmqp._kernel.Account", sizeof(Account), 0,
                           Py_TPFLAGS_DEFAULT | Py_TPFLAGS_DISALLOW_INSTANTIATION, slots};

int add_account_type(PyObject *module)
{
    PyObject *type = PyType_FromSpec(&spec);
    if (type == NULL) return -1;
    account_type = (PyTypeObject *)type; /* kept, so that it outlives the module's dictionary */
    return PyModule_AddType(module, account_type);
}
