/* rcmqp._kernel: what a control cycle cannot afford in numpy. */

#include "arrays.h"
#include "drawn.h"
#include "hierarchy.h"

int add_account_type(PyObject *module);
int add_block_type(PyObject *module);
int add_stack_type(PyObject *module);

PyObject *solve(PyObject *self, PyObject *const *args, Py_ssize_t count);
PyObject *usable(PyObject *self, PyObject *const *args, Py_ssize_t count);
PyObject *frozen(PyObject *self, PyObject *const *args, Py_ssize_t count);
PyObject *record(PyObject *self, PyObject *const *args, Py_ssize_t count);
PyObject *state(PyObject *self, PyObject *const *args, Py_ssize_t count);
PyObject *moved(PyObject *self, PyObject *const *args, Py_ssize_t count);
PyObject *all_finite(PyObject *self, PyObject *const *args, Py_ssize_t count);
PyObject *paced(PyObject *self, PyObject *const *args, Py_ssize_t count);
PyObject *law(PyObject *self, PyObject *const *args, Py_ssize_t count);
PyObject *in_order(PyObject *self, PyObject *const *args, Py_ssize_t count);
PyObject *manipulability(PyObject *self, PyObject *const *args, Py_ssize_t count);
PyObject *least_singular_values(PyObject *self, PyObject *const *args, Py_ssize_t count);
PyObject *from_xyzquat(PyObject *self, PyObject *const *args, Py_ssize_t count);
PyObject *carried(PyObject *self, PyObject *const *args, Py_ssize_t count);
PyObject *view_pose(PyObject *self, PyObject *const *args, Py_ssize_t count);
PyObject *approach(PyObject *self, PyObject *const *args, Py_ssize_t count);
PyObject *store(PyObject *self, PyObject *const *args, Py_ssize_t count);
PyObject *views(PyObject *self, PyObject *const *args, Py_ssize_t count);
PyObject *view_poses(PyObject *self, PyObject *const *args, Py_ssize_t count);
PyObject *observed(PyObject *self, PyObject *const *args, Py_ssize_t count);
PyObject *contour(PyObject *self, PyObject *const *args, Py_ssize_t count);

Arena *scratch(size_t count)
{
    static Arena arena;
    static size_t capacity;
    if (count > capacity) {
        double *memory = PyMem_RawRealloc(arena.memory, sizeof(double) * count);
        if (memory == NULL) {
            PyErr_NoMemory();
            return NULL;
        }
        arena.memory = memory, capacity = count;
    }
    arena.used = 0;
    return &arena;
}

#define METHOD(name, doc) \
    {#name, (PyCFunction)(void (*)(void))name, METH_FASTCALL, doc}

static PyMethodDef methods[] = {
    METHOD(solve, "The lexicographic optimum of stacked levels; see _kernel.pyi."),
    METHOD(usable, "Whether a cycle's numbers are finite and x_d is a pose; see _kernel.pyi."),
    METHOD(frozen, "A copy of numbers that cannot be written."),
    METHOD(record, "An instance of a dataclass with slots, without its __init__."),
    METHOD(state, "The state of an arm."),
    METHOD(moved, "Where joints are a step later."),
    METHOD(all_finite, "Whether all numbers are finite."),
    METHOD(paced, "How fast a damper lets its quantity shrink."),
    METHOD(law, "The paper's law, equation (6)."),
    METHOD(least_singular_values, "Of many Jacobians."),
    METHOD(in_order, "Least squares in order of priority."),
    METHOD(manipulability, "Of RCM and tip, and the way out of a singularity."),
    METHOD(from_xyzquat, "Dual quaternion of a placement."),
    METHOD(carried, "A pose moved in the world's axes."),
    METHOD(view_pose, "The reference of a view, equation (5)."),
    METHOD(approach, "One part of the planner's way, equations (9) to (11)."),
    METHOD(store, "Put the numbers of arrays into a row of a table."),
    METHOD(views, "What a path that the tip draws asks for at many instants."),
    METHOD(view_poses, "The references of many views, equation (5)."),
    METHOD(observed, "What a record says of many poses."),
    METHOD(contour, "How far points are from a curve, and how far along it."),
    {NULL, NULL, 0, NULL},
};

static struct PyModuleDef module = {
    PyModuleDef_HEAD_INIT,
    "rcmqp._kernel",
    "What a control cycle cannot afford in numpy, in C; see the headers in rcmqp/kernel.",
    -1,
    methods,
    NULL,
    NULL,
    NULL,
    NULL,
};

PyMODINIT_FUNC PyInit__kernel(void)
{
    static const struct {
        const char *name;
        long value;
    } constants[] = {
        {"HELIX", HELIX}, {"CIRCLE", CIRCLE}, {"LISSAJOUS", LISSAJOUS}, {"SETS", SETS},
    };
    import_array();
    PyObject *made = PyModule_Create(&module);
    for (size_t i = 0; made != NULL && i < sizeof constants / sizeof *constants; ++i)
        if (PyModule_AddIntConstant(made, constants[i].name, constants[i].value) < 0) Py_CLEAR(made);
    if (made != NULL && (add_block_type(made) < 0 || add_stack_type(made) < 0 ||
                         add_account_type(made) < 0))
        Py_CLEAR(made);
    return made;
}
