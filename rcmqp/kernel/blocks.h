/* Blocks, stacks and solves as Python sees them; see _kernel.pyi. */
#ifndef RCMQP_BLOCKS_H
#define RCMQP_BLOCKS_H

#include "arrays.h"
#include "hierarchy.h"
#include "rows.h"

/* _kernel.Block */
typedef struct {
    PyObject_HEAD
    Block block;
    PyObject *kind, *options; /* what it was made of */
    PyObject *objective;      /* the Block of an OBJECTIVE; NULL for the others */
} BlockObject;

/* How many arguments a cycle is: arrays, and what is known of the tool. */
#define CYCLE_ARRAYS 9
#define CYCLE_ARGUMENTS (CYCLE_ARRAYS + 1)

int is_block(PyObject *object);

int read_cycle(PyObject *const *args, Cycle *cycle);

PyObject *copied(const double *numbers, int rows, int columns);

int check_levels(const Hierarchy *hierarchy, npy_intp rows);

PyObject *answered(const Hierarchy *hierarchy, const double *start, double *sets,
                   PyObject *backend, PyObject *names, Arena *arena);

#endif
