/* Levels of tasks below limits. The rows of each are made here, or given by Python code.
 *
 * Tasks come level by level. A task asks for jacobian v = rate - drift, with the rate of its error
 * that approach.h allows; what shares a level is multiplied by the root of its weight.
 */
#ifndef RCMQP_STACK_H
#define RCMQP_STACK_H

#include "hierarchy.h"
#include "rows.h"

typedef struct {
    const Block *block; /* NULL: the rows are given */
    int level;          /* from 0 */
    double gain, root;  /* 0: the task has no error to reduce; root of its weight */
    int m;              /* rows in this cycle; of given ones, all below too */
    const double *error, *jacobian, *drift;
} StackTask;

typedef struct {
    const Block *block; /* NULL: the box and the rows are given */
    int m;
    const double *lower, *upper, *C, *d;
} StackLimit;

typedef struct {
    int n, levels, task_count, limit_count; /* levels: with the rest */
    StackTask *tasks;
    StackLimit *limits;
    const double *damping;            /* (levels) */
    const double *acceleration, *jerk; /* (n) limits that tasks brake with, infinite for none */
    double share, period;             /* share of them that is counted on; 0: errors go in
                                         proportion */
} Stack;

size_t memory_for_rows(int n, int m, int rows);

void stack_rows(const Stack *stack, const Cycle *cycle, Hierarchy *hierarchy, Arena *arena);

#endif
