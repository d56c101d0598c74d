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

/* A solve whose numbers stand in an arena. */
typedef struct {
    Hierarchy hierarchy;
    Solution solution;
    double *numbers; /* all of an Answer (qp/levels.py), in its order */
    int size;
} Solved;

int solve_in(Solved *solved, const double *start, double *sets, PyObject *backend, Arena *arena);

/* Memory for a solve, and the account of the last one there that is still to be made, or NULL. */
typedef struct Account Account;
typedef struct {
    double *memory;
    size_t capacity;
    Account *account;
} Room;

PyObject *make_account(const Solved *solved, Arena arena, Room *room, PyObject *owner,
                       PyObject *names);

int finish_account(Room *room);

#endif
