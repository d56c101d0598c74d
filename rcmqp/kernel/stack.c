#include "stack.h"

#include "approach.h"

#include <math.h>
#include <string.h>

/* Rows A v = b + rate of one task, and its error e, all times the root of its weight. */
static void rows_of_one(const StackTask *task, const Cycle *cycle, double *A, double *b, double *e,
                        Arena *arena)
{
    const int m = task->m, n = cycle->n;
    if (task->block != NULL) {
        task_rows(cycle, task->block, A, b, e, arena);
    } else {
        memcpy(A, task->jacobian, sizeof(double) * (size_t)(m * n));
        memcpy(e, task->error, sizeof(double) * (size_t)m);
        for (int i = 0; i < m; ++i) b[i] = -task->drift[i];
    }
    if (task->root == 1.0) return;
    for (int i = 0; i < m * n; ++i) A[i] *= task->root;
    for (int i = 0; i < m; ++i) b[i] *= task->root, e[i] *= task->root;
}

/* The part of the box that lies in what is there already; its nearest face if none does. */
static void narrow_box(const StackLimit *limit, int n, double *lower, double *upper)
{
    for (int i = 0; i < n; ++i) {
        const double low = clipped(limit->lower[i], lower[i], upper[i]);
        upper[i] = clipped(limit->upper[i], lower[i], upper[i]), lower[i] = low;
    }
}

size_t memory_for_rows(int n, int m, int rows)
{
    return (size_t)((rows + m + 24) * (n + 10) + n * n + 2 * n) + memory_for_objective(n);
}

static double least_of(const double *x, int n)
{
    double least = INFINITY;
    for (int i = 0; i < n; ++i) least = smaller(least, x[i]);
    return least;
}

/* The problem of a cycle, in the arena: everything of it but where the levels end. */
void stack_rows(const Stack *stack, const Cycle *cycle, Hierarchy *hierarchy, Arena *arena)
{
    const int n = stack->n, rows = (int)hierarchy->ends[stack->levels - 1], m = hierarchy->m;
    double *A = take(arena, rows * n), *b = take(arena, rows), *C = take(arena, m * n);
    double *d = take(arena, m), *lower = take(arena, n), *upper = take(arena, n);
    const size_t mark = arena->used;
    double *e = take(arena, rows), *rate = take(arena, rows);
    const Ability least = {least_of(stack->acceleration, n), least_of(stack->jerk, n)};
    const Brakes brakes = {n,        stack->acceleration, stack->jerk,  cycle->v,
                           cycle->a, least,               stack->share, stack->period};
    int at = 0;
    for (int k = 0; k < stack->task_count; ++k) {
        const StackTask *task = stack->tasks + k;
        const int first = task->level > 0 ? (int)hierarchy->ends[task->level - 1] : 0;
        rows_of_one(task, cycle, A + at * n, b + at, e, arena);
        if (task->gain > 0.0) {
            const int posture = task->block != NULL && task->block->kind == POSTURE;
            const Approached wanted = {task->m, first, A, A + at * n, e, b + at, task->gain,
                                       stack->damping[task->level], posture ? task->root : 0.0};
            approach_rate(&brakes, &wanted, rate, arena);
            for (int i = 0; i < task->m; ++i) b[at + i] += rate[i];
        }
        at += task->m;
    }
    memset(A + at * n, 0, sizeof(double) * (size_t)(n * n));
    for (int i = 0; i < n; ++i) {
        A[(at + i) * n + i] = 1.0, b[at + i] = 0.0;
        lower[i] = -INFINITY, upper[i] = INFINITY;
    }
    at = 0;
    for (int k = 0; k < stack->limit_count; ++k) {
        const StackLimit *limit = stack->limits + k;
        if (limit->block != NULL) {
            limit_rows(cycle, limit->block, lower, upper, C + at * n, d + at, arena);
        } else {
            narrow_box(limit, n, lower, upper);
            memcpy(C + at * n, limit->C, sizeof(double) * (size_t)(limit->m * n));
            memcpy(d + at, limit->d, sizeof(double) * (size_t)limit->m);
        }
        at += limit->m;
    }
    hierarchy->A = A, hierarchy->b = b, hierarchy->C = C, hierarchy->d = d;
    hierarchy->lower = lower, hierarchy->upper = upper;
    arena->used = mark;
}
