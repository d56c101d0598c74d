#include "cascade.h"

#include <math.h>
#include <string.h>

/* A unit row whose part in the free directions is below this cannot change any more. */
#define FIXED 1e-11

/* A unit row that is exceeded by less is kept, times its size where that is above one. */
#define CARRIED 1e-12

/* A hard row that is exceeded by less, times its size where that is above one, is not fixed: it
 * may be rounding. It stays an inequality. */
#define FROZEN 1e-9

/* Euclidean norm, roughly so where squares over- or underflow. */
double norm_of(const double *x, int count)
{
    double largest = 0.0;
    const double norm = sqrt(dot(x, x, count));
    if (norm > 1e-150 && norm < LARGEST) return norm;
    for (int i = 0; i < count; ++i) largest = larger(largest, fabs(x[i]));
    return largest;
}

/* dot product of a row with column j of Z */
static double along(const State *state, const double *row, int j)
{
    double total = 0.0;
    for (int p = 0; p < state->n; ++p) total += row[p] * state->Z[p * state->n + j];
    return total;
}

/* Z <- Z Q[:, rank:]; Q (free, free). */
static void turn(State *state, const double *Q, int rank, Arena *arena)
{
    const size_t mark = arena->used;
    const int n = state->n, free = state->free;
    double *line = take(arena, free);
    for (int i = 0; i < n; ++i) {
        memcpy(line, state->Z + i * n, sizeof(double) * (size_t)free);
        for (int j = rank; j < free; ++j) {
            double total = 0.0;
            for (int p = 0; p < free; ++p) total += line[p] * Q[p * free + j];
            state->Z[i * n + j - rank] = total;
        }
    }
    state->free = free - rank;
    arena->used = mark;
}

/* Take the span of rows (count, n), of about unit norm, out of the free directions. */
void narrow(State *state, const double *rows, int count, Arena *arena)
{
    const size_t mark = arena->used;
    const int free = state->free;
    double *B = take(arena, count * free), *L = take(arena, count * free);
    double *Q = take(arena, free * free);
    int *order = (int *)take(arena, count);
    for (int i = 0; i < count; ++i)
        for (int j = 0; j < free; ++j) B[i * free + j] = along(state, rows + i * state->n, j);
    turn(state, Q, factor(B, count, free, RANK_TOL, L, Q, order), arena);
    arena->used = mark;
}

static void move(State *state, const double *y)
{
    for (int p = 0; p < state->n; ++p) state->v[p] += dot(state->Z + p * state->n, y, state->free);
}

/* A level A (m, n), b (m) in the free coordinates; rows (N) says which bound each row of R is. */
void make_problem(const State *state, const double *A, const double *b, int m, Problem *problem,
                  int *rows, Arena *arena)
{
    const int n = state->n, free = state->free, N = state->N;
    double *R = take(arena, N * free), *lower = take(arena, N), *upper = take(arena, N);
    const double weight = norm_of(A, m * n);
    double total = 0.0;
    *problem = (Problem){m, free, 0, take(arena, m * free), take(arena, m), take(arena, m),
                         R, lower,  upper, weight, 0.0};
    if (weight == 0.0) return;
    for (int i = 0; i < m; ++i) {
        double Av = 0.0, noise = fabs(b[i] / weight);
        for (int p = 0; p < n; ++p) {
            const double term = A[i * n + p] / weight * state->v[p];
            Av += term, noise += fabs(term);
        }
        problem->c[i] = b[i] / weight - Av, problem->noise[i] = EPS * noise;
        total += Av * Av;
        for (int j = 0; j < free; ++j)
            problem->M[i * free + j] = along(state, A + i * n, j) / weight;
    }
    problem->scale = norm_of(b, m) / weight + sqrt(total);
    for (int i = 0; i < N; ++i) {
        if (state->lower[i] == -INFINITY && state->upper[i] == INFINITY) continue;
        const double Gv = dot(state->G + i * n, state->v, n);
        double *row = R + problem->k * free;
        for (int j = 0; j < free; ++j) row[j] = along(state, state->G + i * n, j);
        if (!(dot(row, row, free) > FIXED * FIXED)) continue;
        lower[problem->k] = smaller(state->lower[i] - Gv, 0.0);
        upper[problem->k] = larger(state->upper[i] - Gv, 0.0);
        rows[problem->k++] = i;
    }
}

static int overflows(const Problem *problem)
{
    return !(problem->weight < LARGEST && problem->scale < LARGEST);
}

/* From a point in the box, exceed the hard rows least; carry the excess in `upper`.
 *
 * min sum_i max(0, C_i v - d_i)^2 in the box. The rows V exceeded at the optimum are searched:
 * least squares of V's excess while the other rows are kept; then a row that ends below its bound
 * leaves V, and one whose multiplier says that exceeding it pays enters. The sum falls from round
 * to round, so that no V comes back. */
Route satisfy_rows(State *state, int max_rounds, double *multipliers, int *rounds, Arena *arena)
{
    const size_t mark = arena->used;
    const int n = state->n, N = state->N;
    double *A = take(arena, N * n), *b = take(arena, N), *upper = state->upper;
    double *over = take(arena, N), *relaxed = take(arena, N), *none = take(arena, N);
    double *lam = take(arena, N), *y = take(arena, n), strong = INFINITY;
    int *V = (int *)take(arena, N), *index = (int *)take(arena, N);
    Route route = CLOSED_FORM;
    memset(none, 0, sizeof(double) * (size_t)N);
    for (int i = 0; i < N; ++i) V[i] = 0;
    *rounds = 0;
    for (int round = 0;; ++round) {
        int same = round > 0, m = 0;
        for (int i = 0; i < N; ++i) {
            const double Gv = dot(state->G + i * n, state->v, n);
            over[i] = (Gv - upper[i]) / (CARRIED * larger(1.0, fabs(Gv)));
            relaxed[i] = upper[i];
            if (i < n || state->norms[i] == 0.0) continue;
            const int before = V[i];
            V[i] = before ? over[i] > -1.0 : round == 0 && over[i] > 1.0;
            if (fabs(multipliers[i]) > strong) V[i] = 1;
            if (V[i] != before) same = 0;
            if (!V[i]) continue;
            for (int p = 0; p < n; ++p) A[m * n + p] = state->G[i * n + p] * state->norms[i];
            b[m++] = upper[i] * state->norms[i];
            relaxed[i] = INFINITY;
        }
        if (m == 0) {
            memset(multipliers, 0, sizeof(double) * (size_t)N);
            break;
        }
        if (same) { /* what decides the optimum stays */
            int count = 0;
            for (int i = 0; i < N; ++i) {
                if (!(V[i] && over[i] * CARRIED > FROZEN) &&
                    !(i < n && fabs(multipliers[i]) > strong))
                    continue;
                memcpy(A + count++ * n, state->G + i * n, sizeof(double) * (size_t)n);
            }
            narrow(state, A, count, arena);
            break;
        }
        if (round == max_rounds) {
            route = UNVERIFIED;
            break;
        }
        const size_t inner = arena->used;
        Problem problem;
        State open = *state;
        open.upper = relaxed;
        make_problem(&open, A, b, m, &problem, index, arena);
        if (overflows(&problem)) {
            route = KEPT;
            break;
        }
        const int used = solve_level(&problem, max_rounds, none, y, lam, arena);
        const double square = problem.weight * problem.weight;
        move(state, y);
        *rounds += used > 0 ? used : -used;
        route = used > 0 ? ACTIVE_SET : UNVERIFIED;
        strong = STRONG * problem.scale * square;
        memset(multipliers, 0, sizeof(double) * (size_t)N);
        for (int i = 0; i < problem.k; ++i) multipliers[index[i]] = lam[i] * square;
        arena->used = inner;
    }
    for (int i = n; i < N; ++i)
        upper[i] = larger(upper[i], dot(state->G + i * n, state->v, n));
    arena->used = mark;
    return route;
}

/* One level: move to where |A v - b| is least, and keep A v from now on.
 *
 * Where a bound is in the way, `ask` is set and the proposed active set is not right at once,
 * nothing is done and the answer is BLOCKED. */
Route descend(State *state, const double *A, const double *b, int m, int max_rounds,
              const double *proposed, int ask, double *multipliers, int *rounds, Arena *arena)
{
    const size_t mark = arena->used;
    const int n = state->n, free = state->free;
    double *y = take(arena, free), *Q = take(arena, free * free), *U = take(arena, m * m);
    int *index = (int *)take(arena, state->N), range;
    Route route = CLOSED_FORM;
    Problem problem;
    *rounds = 0;
    if (free == 0 || m == 0) return CLOSED_FORM;
    make_problem(state, A, b, m, &problem, index, arena);
    const int k = problem.k;
    if (problem.weight == 0.0) goto done;
    if (overflows(&problem)) {
        route = KEPT;
        goto done;
    }
    const int rank = pseudo_solve(problem.M, m, free, problem.c, y, Q, U, &range, arena);
    if (rank >= 0 && feasible(&problem, y)) {
        move(state, y);
        turn(state, Q, rank, arena);
        goto done;
    }
    double *guess = take(arena, k), *lam = take(arena, k), *kept = take(arena, (m + k) * n);
    int guessed = 0;
    for (int i = 0; i < k; ++i) {
        guess[i] = proposed[index[i]], lam[i] = 0.0;
        if (guess[i] != 0.0) guessed = 1;
    }
    if (ask && !guessed) {
        route = BLOCKED;
        goto done;
    }
    *rounds = solve_level(&problem, ask ? 1 : max_rounds, guess, y, lam, arena);
    if (ask && *rounds != 1) {
        *rounds = 0, route = BLOCKED;
        goto done;
    }
    if (*rounds < 0) { /* a guess so bad that it cost digits: start without */
        memset(guess, 0, sizeof(double) * (size_t)k);
        *rounds = solve_level(&problem, max_rounds, guess, y, lam, arena);
    }
    route = *rounds == 1 ? POLISHED : ACTIVE_SET;
    if (*rounds < 0) {
        route = UNVERIFIED, *rounds = -*rounds;
        if (!feasible(&problem, y)) goto done;
    }
    move(state, y);
    int count = m;
    for (int i = 0; i < m * n; ++i) kept[i] = A[i] / problem.weight;
    for (int i = 0; i < k; ++i) {
        multipliers[index[i]] = lam[i] * problem.weight * problem.weight;
        if (fabs(lam[i]) > STRONG * problem.scale)
            memcpy(kept + count++ * n, state->G + index[i] * n, sizeof(double) * (size_t)n);
    }
    narrow(state, kept, count, arena);
done:
    arena->used = mark;
    return route;
}

/* Residual of a level's optimality conditions at v, from the problem's own numbers.
 *
 * The larger of: gradient A^T residual + G^T multipliers along Z (n, n), its first `free` columns,
 * what was free before the level, and multiplier times slack at the bound of the multiplier's
 * sign, over `small`; both over the size of A times b, or `small`. */
double kkt_residual(const State *state, const double *A, const double *b, int m,
                    const double *residual, const double *multipliers, const double *Z, int free,
                    double small, Arena *arena)
{
    const size_t mark = arena->used;
    const int n = state->n;
    double *gradient = take(arena, n), worst = 0.0;
    const double scale =
        larger(small, norm_of(A, m * n) * larger(norm_of(b, m), norm_of(residual, m)));
    memset(gradient, 0, sizeof(double) * (size_t)n);
    for (int i = 0; i < m; ++i)
        for (int p = 0; p < n; ++p) gradient[p] += A[i * n + p] * residual[i];
    for (int i = 0; i < state->N; ++i) {
        const double lam = multipliers[i];
        if (lam == 0.0) continue;
        const double Gv = dot(state->G + i * n, state->v, n);
        for (int p = 0; p < n; ++p) gradient[p] += state->G[i * n + p] * lam;
        const double slack = lam > 0.0 ? state->upper[i] - Gv : Gv - state->lower[i];
        worst = larger(worst, fabs(lam * slack) / small);
    }
    for (int j = 0; j < free; ++j) {
        double part = 0.0;
        for (int p = 0; p < n; ++p) part += Z[p * n + j] * gradient[p];
        if (!(fabs(part) <= worst)) worst = fabs(part);
    }
    arena->used = mark;
    worst /= scale;
    return worst < INFINITY ? worst : INFINITY;
}
