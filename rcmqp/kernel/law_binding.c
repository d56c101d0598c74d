/* The paper's law, its objectives, references and planner for Python; see _kernel.pyi. */

#define NO_IMPORT_ARRAY
#include "blocks.h"
#include "dualquaternion.h"
#include "law.h"
#include "planning.h"
#include "reference.h"
#include "svd.h"

/* A new array (size) of zeros; *numbers are its own. */
static PyObject *vector(npy_intp size, double **numbers)
{
    PyObject *array = PyArray_ZEROS(1, &size, NPY_DOUBLE, 0);
    if (array != NULL) *numbers = PyArray_DATA((PyArrayObject *)array);
    return array;
}

/* Columns of a C-contiguous array (..., 6, n), or -1 with a Python error. */
static npy_intp joints_of(PyObject *object, int dimensions)
{
    if (numbers_of(object, NPY_DOUBLE, -1, "J_local") == NULL) return -1;
    PyArrayObject *array = (PyArrayObject *)object;
    if (PyArray_NDIM(array) == dimensions && PyArray_DIM(array, dimensions - 2) == 6)
        return PyArray_DIM(array, dimensions - 1);
    PyErr_SetString(PyExc_ValueError, "J_local must have six rows");
    return -1;
}

/* The objective: a Block that fits n joints, or its value c and gradient J_c as they are given. 0
 * with a Python error. */
static int objective_of(PyObject *aim, npy_intp n, const Block **block, double *c,
                        const double **J_c)
{
    PyObject *value = NULL, *gradient = NULL;
    if (is_block(aim)) {
        *block = &((BlockObject *)aim)->block;
        if ((*block)->kind >= FIRST_OBJECTIVE && rows_of(*block, (int)n) >= 0) return 1;
        PyErr_SetString(PyExc_ValueError, "the objective is of another kind, or for another arm");
        return 0;
    }
    if (!PyTuple_Check(aim)) {
        PyErr_SetString(PyExc_TypeError, "the objective must be a Block or a tuple");
        return 0;
    }
    if (!PyArg_UnpackTuple(aim, "the objective", 2, 2, &value, &gradient)) return 0;
    *c = PyFloat_AsDouble(value); /* which may call Python, so it comes before all arrays */
    if (PyErr_Occurred()) return 0;
    *J_c = numbers_of(gradient, NPY_DOUBLE, n, "J_c");
    return !PyErr_Occurred();
}

/* law(x, J_local, angles, x_d, x_d_dot, objective, numbers, limits, feed_forward, limited);
 * objective: its Block; or its value c and its gradient J_c. */
PyObject *law(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    (void)self;
    if (!counted("law", count, 10)) return NULL;
    const npy_intp n = joints_of(args[1], 2);
    if (n >= 0 && n < RANK) PyErr_SetString(PyExc_ValueError, "the law needs six joints or more");
    Sight sight = {0};
    const Block *block = NULL;
    if (PyErr_Occurred() || !objective_of(args[5], n, &block, &sight.c, &sight.J_c)) return NULL;
    sight.x = numbers_of(args[0], NPY_DOUBLE, 8, "x");
    sight.J = numbers_of(args[1], NPY_DOUBLE, 6 * n, "J_local");
    sight.x_d = numbers_of(args[3], NPY_DOUBLE, 8, "x_d");
    sight.x_d_dot = numbers_of(args[4], NPY_DOUBLE, 8, "x_d_dot");
    const double *angles = numbers_of(args[2], NPY_DOUBLE, n, "angles");
    const Law made = {
        (int)n,
        numbers_of(args[6], NPY_DOUBLE, LAW_NUMBERS, "numbers"),
        numbers_of(args[7], NPY_DOUBLE, n, "limits"),
        count_of(args[8], 1, "feed_forward"),
        (Limited)count_of(args[9], CLIP, "limited"),
    };
    double *v = NULL;
    if (PyErr_Occurred()) return NULL;
    PyObject *answer = vector(n, &v);
    const size_t size = memory_for_law((int)n) + memory_for_objective((int)n) + (size_t)n;
    Arena *arena = answer == NULL ? NULL : scratch(size);
    if (arena == NULL) {
        Py_XDECREF(answer);
        return NULL;
    }
    if (block != NULL) {
        double *gradient = take(arena, (int)n);
        sight.c = objective_value(block, sight.J, angles, (int)n, gradient, arena);
        sight.J_c = gradient;
    }
    Found found;
    follow(&made, &sight, v, &found, arena);
    return Py_BuildValue("(Ndddd)", answer, sight.c, found.least, found.kept, found.scale);
}

/* least_singular_values(J) */
PyObject *least_singular_values(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    (void)self;
    if (!counted("least_singular_values", count, 1)) return NULL;
    const npy_intp n = joints_of(args[0], 3);
    Arena *arena = n < 0 ? NULL : scratch((size_t)(n * n + 12 * n + 6 * RANK + RANK * RANK));
    if (arena == NULL) return NULL;
    const double *J = PyArray_DATA((PyArrayObject *)args[0]);
    const npy_intp m = PyArray_DIM((PyArrayObject *)args[0], 0);
    double *numbers = NULL;
    PyObject *least = vector(m, &numbers);
    for (npy_intp k = 0; least != NULL && k < m; ++k)
        numbers[k] = least_singular_value(J + 6 * n * k, 6, (int)n, arena);
    return least;
}

/* from_xyzquat(placement) */
PyObject *from_xyzquat(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    (void)self;
    if (!counted("from_xyzquat", count, 1)) return NULL;
    const double *placement = numbers_of(args[0], NPY_DOUBLE, 7, "placement");
    double x[8];
    if (placement == NULL) return NULL;
    dq_of_xyzquat(placement, x);
    return copied(x, 8, -1);
}

/* carried(x, offset) */
PyObject *carried(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    (void)self;
    if (!counted("carried", count, 2)) return NULL;
    const double *x = numbers_of(args[0], NPY_DOUBLE, 8, "x");
    const double *offset = numbers_of(args[1], NPY_DOUBLE, 3, "offset");
    if (PyErr_Occurred()) return NULL;
    if (offset[0] == 0.0 && offset[1] == 0.0 && offset[2] == 0.0) return Py_NewRef(args[0]);
    double *numbers = NULL;
    PyObject *moved = vector(8, &numbers);
    if (moved == NULL) return NULL;
    memcpy(numbers, x, 8 * sizeof(double));
    dq_carry(x, offset, 1.0, numbers);
    return moved;
}

/* view_pose(cls, x_rcm, alpha, beta, gamma, t_z, alpha_dot, beta_dot, gamma_dot, t_z_dot, pivot_dot):
 * a Reference of x_d, x_d_dot, pivot and pivot_dot, none of them to be written or anybody else's; None
 * if the shape of x_rcm is not (8,) or that of pivot_dot not (3,). */
PyObject *view_pose(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    (void)self;
    if (!counted("view_pose", count, VIEW_NUMBERS + 3)) return NULL;
    double view[VIEW_NUMBERS], x_d[8], x_d_dot[8], pivot[3];
    for (int i = 0; i < VIEW_NUMBERS; ++i) {
        view[i] = PyFloat_AsDouble(args[2 + i]);
        if (view[i] == -1.0 && PyErr_Occurred()) return NULL;
    }
    PyArrayObject *x_rcm = numbers_in(args[1]), *pivot_dot = NULL;
    if (x_rcm != NULL) pivot_dot = numbers_in(args[VIEW_NUMBERS + 2]);
    PyObject *answer = NULL;
    if (pivot_dot != NULL && is_vector(x_rcm, 8) && is_vector(pivot_dot, 3)) {
        const double *rate = PyArray_DATA(pivot_dot);
        pose_of_view(PyArray_DATA(x_rcm), view, rate, x_d, x_d_dot, pivot);
        const int own = PyArray_ISWRITEABLE(pivot_dot); /* the caller's, who may change it */
        PyObject *fields[] = {copied(x_d, 8, -1), copied(x_d_dot, 8, -1), copied(pivot, 3, -1),
                              own ? copied(rate, 3, -1) : Py_NewRef((PyObject *)pivot_dot)};
        if (!PyErr_Occurred()) answer = record_of(args[0], fields, 4);
        for (int i = 0; i < 4; ++i) Py_XDECREF(fields[i]);
    } else if (pivot_dot != NULL) {
        answer = Py_NewRef(Py_None);
    }
    Py_XDECREF(x_rcm);
    Py_XDECREF(pivot_dot);
    return answer;
}

/* approach(x_rcm, pivot_0, x, target, left, parts, period, x_wanted, pivot, pivot_dot, far_angle,
 *          far_depth) */
PyObject *approach(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    (void)self;
    if (!counted("approach", count, 12)) return NULL;
    const Plan plan = {
        numbers_of(args[0], NPY_DOUBLE, 8, "x_rcm"),
        numbers_of(args[1], NPY_DOUBLE, 3, "pivot_0"),
        count_of(args[5], INT_MAX, "parts"),
        number_of(args[6]),
        number_of(args[10]),
        number_of(args[11]),
    };
    const Wanted wanted = {
        numbers_of(args[7], NPY_DOUBLE, 8, "x_d"),
        numbers_of(args[8], NPY_DOUBLE, 3, "pivot"),
        numbers_of(args[9], NPY_DOUBLE, 3, "pivot_dot"),
    };
    const double *x = numbers_of(args[2], NPY_DOUBLE, 8, "x");
    const double *target = numbers_of(args[3], NPY_DOUBLE, 8, "target");
    Place place = {.left = count_of(args[4], INT_MAX, "left")};
    if (PyErr_Occurred()) return NULL;
    double *x_d = NULL, *x_d_dot = NULL;
    PyObject *made[] = {vector(8, &place.x), vector(8, &place.target), vector(8, &x_d),
                        vector(8, &x_d_dot)};
    int moved = 0;
    if (!PyErr_Occurred()) {
        memcpy(place.x, x, 8 * sizeof(double));
        memcpy(place.target, target, 8 * sizeof(double));
        moved = go_on(&plan, &place, &wanted, x_d, x_d_dot);
    }
    return Py_BuildValue("(NNiNNN)", made[0], made[1], place.left, made[2], made[3],
                         PyBool_FromLong(moved));
}
