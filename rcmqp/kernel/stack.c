#include "stack.h"

#include "approach.h"

#include <math.h>
#include <string.h>

/* An objective moves no joint where it would move each by less than the first share of its speed
 * limit, and all as fast as it asks for from the second on: the end of its ascent takes long and
 * gains next to nothing. */
#define IDLE 0.03
#define LIVELY 0.045

/* The weight of the rows above is at most this, over their norm: its square leaves digits for the 1
 * that they are added to. */
#define HEAVIEST 1e4

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

/* The wish g (n) of an objective, less where what the levels above leave of it is slow.
 *
 * That is (I + B^T B)^-1 g, with B their rows A as cascade.h has them, A_j / exchange_j. */
static void ease_off(const Stack *stack, const StackTask *objective, const double *A, double *g,
                     Arena *arena)
{
    const size_t mark = arena->used;
    const int n = stack->n;
    double *S = take(arena, n * n), *left = take(arena, n), fastest = 0.0;
    memset(S, 0, sizeof(double) * (size_t)(n * n));
    for (const StackTask *task = stack->tasks; task->level < objective->level; ++task) {
        const double by = 1.0 / larger(EXCHANGE * stack->damping[task->level],
                                       norm_of(A, task->m * n) / HEAVIEST);
        for (int i = 0; i < task->m; ++i, A += n)
            for (int p = 0; p < n && by < INFINITY; ++p)
                add_to(S + p * n, by * by * A[p], A, p + 1);
    }
    for (int i = 0; i < n; ++i) S[i * n + i] += 1.0;
    memcpy(left, g, sizeof(double) * (size_t)n);
    cholesky(S, n);
    cholesky_solve(S, n, left);
    for (int i = 0; i < n; ++i) fastest = larger(fastest, fabs(left[i]) / stack->velocity[i]);
    const double share = larger(fastest - IDLE, 0.0) / (LIVELY - IDLE);
    for (int i = 0; i < n && share < 1.0; ++i) g[i] *= share;
    arena->used = mark;
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

/* The problem of a cycle, in the arena: everything of it but where the levels end. */
void stack_rows(const Stack *stack, const Cycle *cycle, Hierarchy *hierarchy, Arena *arena)
{
    const int n = stack->n, rows = (int)hierarchy->ends[stack->levels - 1], m = hierarchy->m;
    double *A = take(arena, rows * n), *b = take(arena, rows), *C = take(arena, m * n);
    double *d = take(arena, m), *lower = take(arena, n), *upper = take(arena, n);
    const size_t mark = arena->used;
    double *e = take(arena, rows), *rate = take(arena, rows);
    const Brakes brakes = {n,        stack->acceleration, stack->jerk, cycle->v,
                           cycle->a, stack->share,        stack->period};
    int at = 0;
    for (int k = 0; k < stack->task_count; ++k) {
        const StackTask *task = stack->tasks + k;
        const int first = task->level > 0 ? (int)hierarchy->ends[task->level - 1] : 0;
        rows_of_one(task, cycle, A + at * n, b + at, e, arena);
        if (task->gain > 0.0) {
            const Approached wanted = {task->m, first,  A, A + at * n, e, b + at, task->gain,
                                       stack->damping[task->level]};
            approach_rate(&brakes, &wanted, rate, arena);
            for (int i = 0; i < task->m; ++i) b[at + i] += rate[i];
        } else if (stack->share > 0.0 && first > 0 && task->m == n) {
            ease_off(stack, task, A, b + at, arena);
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
            limit_rows(cycle, limit->block, lower, upper, C + at * n, d + at);
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
