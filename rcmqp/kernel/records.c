/* What a cycle's objects are made of: frozen arrays, records without Python's constructor, states of
 * an arm, a step of the joints. */

#define NO_IMPORT_ARRAY
#include "blocks.h"
#include "dualquaternion.h"

#include <structmember.h>

PyObject *frozen(PyObject *self, PyObject *const *args, Py_ssize_t count);
PyObject *record(PyObject *self, PyObject *const *args, Py_ssize_t count);
PyObject *state(PyObject *self, PyObject *const *args, Py_ssize_t count);
PyObject *moved(PyObject *self, PyObject *const *args, Py_ssize_t count);
PyObject *all_finite(PyObject *self, PyObject *const *args, Py_ssize_t count);

/* A copy as float64, C-contiguous; quick for float64 arrays of one or two dimensions. */
static PyArrayObject *copy_of(PyObject *values)
{
    PyArrayObject *from = (PyArrayObject *)values;
    if (!PyArray_Check(values) || PyArray_TYPE(from) != NPY_DOUBLE || PyArray_NDIM(from) > 2 ||
        PyArray_NDIM(from) == 0 || !PyArray_ISBEHAVED_RO(from)) {
        const int flags = NPY_ARRAY_CARRAY | NPY_ARRAY_ENSURECOPY | NPY_ARRAY_ENSUREARRAY;
        return (PyArrayObject *)PyArray_FromAny(values, PyArray_DescrFromType(NPY_DOUBLE), 0, 0,
                                                flags | NPY_ARRAY_FORCECAST, NULL);
    }
    PyArrayObject *made = (PyArrayObject *)PyArray_SimpleNew(PyArray_NDIM(from),
                                                             PyArray_DIMS(from), NPY_DOUBLE);
    if (made == NULL) return NULL;
    const int last = PyArray_NDIM(from) - 1;
    const npy_intp width = PyArray_DIM(from, last), across = PyArray_STRIDE(from, last);
    const npy_intp height = last > 0 ? PyArray_DIM(from, 0) : 1;
    const npy_intp down = last > 0 ? PyArray_STRIDE(from, 0) : 0;
    const char *row = PyArray_BYTES(from);
    double *to = PyArray_DATA(made);
    for (npy_intp i = 0; i < height; ++i, row += down)
        for (npy_intp j = 0; j < width; ++j) *to++ = *(const double *)(row + j * across);
    return made;
}

/* frozen(values, size, ...): a copy of that shape (-1: any size) as float64, C-contiguous, that
 * cannot be written; None if the shape is another. */
PyObject *frozen(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    (void)self;
    if (count < 2) {
        PyErr_Format(PyExc_TypeError, "frozen() takes values and a shape, %zd given", count);
        return NULL;
    }
    PyArrayObject *array = copy_of(args[0]);
    if (array == NULL) return NULL;
    int fits = PyArray_NDIM(array) == count - 1;
    for (int i = 0; fits && !PyErr_Occurred() && i < PyArray_NDIM(array); ++i) {
        const Py_ssize_t size = PyLong_AsSsize_t(args[i + 1]);
        fits = size < 0 || PyArray_DIM(array, i) == size;
    }
    if (!fits || PyErr_Occurred()) {
        Py_DECREF(array);
        if (PyErr_Occurred()) return NULL;
        Py_RETURN_NONE;
    }
    PyArray_CLEARFLAGS(array, NPY_ARRAY_WRITEABLE);
    return (PyObject *)array;
}

/* Where the fields of a class stand in its instances, in order. */
#define MOST_FIELDS 16
#define MOST_CLASSES 16
typedef struct {
    PyTypeObject *type;
    Py_ssize_t count, places[MOST_FIELDS];
} Layout;

/* Whether it and all that it derives from are made in Python: zeros are no ndarray, for example. */
static int made_in_python(const PyTypeObject *type)
{
    const destructor own = type->tp_dealloc;
    for (; type != NULL && type != &PyBaseObject_Type; type = type->tp_base)
        if (type->tp_dealloc != own || !(type->tp_flags & Py_TPFLAGS_HEAPTYPE)) return 0;
    return 1;
}

/* The layout of a dataclass with slots; 0 with a Python error. */
static int read_layout(PyTypeObject *type, Layout *layout)
{
    PyObject *names = PyObject_GetAttrString((PyObject *)type, "__match_args__");
    if (names == NULL) return 0;
    *layout = (Layout){type, PyTuple_Check(names) ? PyTuple_GET_SIZE(names) : -1, {0}};
    int slots = made_in_python(type) && layout->count >= 0 && layout->count <= MOST_FIELDS;
    for (Py_ssize_t i = 0; slots && i < layout->count; ++i) {
        PyObject *slot = PyObject_GetAttr((PyObject *)type, PyTuple_GET_ITEM(names, i));
        slots = slot != NULL && Py_IS_TYPE(slot, &PyMemberDescr_Type) &&
                PyType_IsSubtype(type, PyDescr_TYPE(slot)) && /* another's is at another place */
                ((PyMemberDescrObject *)slot)->d_member->type == T_OBJECT_EX &&
                !(((PyMemberDescrObject *)slot)->d_member->flags & READONLY);
        if (slots) layout->places[i] = ((PyMemberDescrObject *)slot)->d_member->offset;
        Py_XDECREF(slot);
    }
    Py_DECREF(names);
    if (!slots && !PyErr_Occurred())
        PyErr_Format(PyExc_TypeError, "%s is no dataclass with slots, of %d at the most",
                     type->tp_name, MOST_FIELDS);
    return slots;
}

/* The same, remembered; `own` where there is no room. What is remembered is kept alive. All threads
 * share it, as the GIL is held: it cannot do without. */
static const Layout *layout_of(PyTypeObject *type, Layout *own)
{
    static Layout known[MOST_CLASSES];
    static int count;
    for (int i = 0; i < count; ++i)
        if (known[i].type == type) return &known[i];
    if (!read_layout(type, own)) return NULL;
    if (count == MOST_CLASSES) return own;
    Py_INCREF(type);
    known[count] = *own;
    return &known[count++];
}

/* cls(...) for a dataclass with slots, but for its __post_init__, every field given; one given as
 * Ellipsis is left empty. A frozen one's own __init__ takes some 100 ns a field; this 3 where the
 * class is remembered, else about 50. */
PyObject *record_of(PyObject *cls, PyObject *const *fields, Py_ssize_t count)
{
    Layout own;
    if (!PyType_Check(cls)) {
        PyErr_SetString(PyExc_TypeError, "a record is of a dataclass");
        return NULL;
    }
    PyTypeObject *type = (PyTypeObject *)cls;
    const Layout *layout = layout_of(type, &own);
    if (layout == NULL) return NULL;
    if (layout->count != count) {
        PyErr_Format(PyExc_TypeError, "record() needs every field of %s", type->tp_name);
        return NULL;
    }
    PyObject *made = type->tp_alloc(type, 0);
    for (Py_ssize_t i = 0; made != NULL && i < count; ++i)
        if (fields[i] != Py_Ellipsis)
            *(PyObject **)((char *)made + layout->places[i]) = Py_NewRef(fields[i]);
    return made;
}

/* record(cls, ...), see record_of() */
PyObject *record(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    (void)self;
    if (count < 1) {
        PyErr_SetString(PyExc_TypeError, "record() takes a dataclass and its fields");
        return NULL;
    }
    return record_of(args[0], args + 1, count - 1);
}

/* A copy of a vector (size) that cannot be written, or `other` for None; NULL if its size is another,
 * or, with an error, if numpy makes no numbers of it. */
static PyArrayObject *rate_of(PyObject *values, npy_intp size, PyObject *other)
{
    if (values == Py_None) return (PyArrayObject *)Py_NewRef(other);
    PyArrayObject *rate = copy_of(values);
    if (rate == NULL) return NULL;
    PyArray_CLEARFLAGS(rate, NPY_ARRAY_WRITEABLE);
    if (!is_vector(rate, size)) Py_CLEAR(rate);
    return rate;
}

/* state(cls, q, angles, oMe, placement, J_local, v, a, still, tool_at): an ArmState of a placement
 * as dq_of_xyzquat() takes it, and of copies of J_local, v and a; still (nv,) stands for a v or an a
 * that is None. The answer is None if the shape of v or a is not (nv,). */
PyObject *state(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    double x[8];
    (void)self;
    if (!counted("state", count, 10)) return NULL;
    const npy_intp nv = size_of(args[8]);
    PyArrayObject *J = copy_of(args[5]), *v = J == NULL ? NULL : rate_of(args[6], nv, args[8]);
    PyArrayObject *a = v == NULL ? NULL : rate_of(args[7], nv, args[8]);
    const double *placement = numbers_of(args[4], NPY_DOUBLE, 7, "placement");
    PyObject *made = NULL;
    if (a != NULL && placement != NULL) {
        PyArray_CLEARFLAGS(J, NPY_ARRAY_WRITEABLE);
        dq_of_xyzquat(placement, x);
        PyObject *pose = copied(x, 8, -1);
        PyObject *fields[] = {args[1], args[2], args[3], pose,
                              (PyObject *)J, (PyObject *)v, (PyObject *)a, args[9]};
        if (pose != NULL) made = record_of(args[0], fields, 8);
        Py_XDECREF(pose);
    } else if (!PyErr_Occurred()) {
        made = Py_NewRef(Py_None);
    }
    Py_XDECREF(J);
    Py_XDECREF(v);
    Py_XDECREF(a);
    return made;
}

/* moved(q, v, dt, size): q + dt v; None if the shape of q or v is not (size,). */
PyObject *moved(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    (void)self;
    if (!counted("moved", count, 4)) return NULL;
    const double dt = PyFloat_AsDouble(args[2]);
    npy_intp size = PyErr_Occurred() ? 0 : PyLong_AsSsize_t(args[3]);
    if (PyErr_Occurred()) return NULL;
    PyArrayObject *q = numbers_in(args[0]), *v = q == NULL ? NULL : numbers_in(args[1]);
    PyObject *next = NULL;
    if (v != NULL && is_vector(q, size) && is_vector(v, size)) {
        if ((next = PyArray_SimpleNew(1, &size, NPY_DOUBLE)) != NULL) {
            const double *from = PyArray_DATA(q), *by = PyArray_DATA(v);
            double *to = PyArray_DATA((PyArrayObject *)next);
            for (npy_intp i = 0; i < size; ++i) to[i] = from[i] + dt * by[i];
        }
    } else if (v != NULL) {
        next = Py_NewRef(Py_None);
    }
    Py_XDECREF(q);
    Py_XDECREF(v);
    return next;
}

/* all_finite(values), all_finite(values, below): whether every number is finite; or smaller in size
 * than that. */
PyObject *all_finite(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    (void)self;
    if (count != 2 && !counted("all_finite", count, 1)) return NULL;
    const double below = count == 2 ? PyFloat_AsDouble(args[1]) : INFINITY;
    PyArrayObject *array = PyErr_Occurred() ? NULL : numbers_in(args[0]);
    if (array == NULL) return NULL;
    const double *numbers = PyArray_DATA(array);
    int all = 1;
    const npy_intp size = numbers_count(array);
    for (npy_intp i = 0; i < size; ++i) all = all && fabs(numbers[i]) < below;
    Py_DECREF(array);
    return PyBool_FromLong(all);
}
