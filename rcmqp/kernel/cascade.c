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

/* Rounding in the gradient |H|^2 |v| of the heavy rows that hold damped levels, over EXACT
 * (hierarchy.c). */
#define HEAVY_NOISE 4e-6

/* Euclidean norm, roughly so where squares over- or underflow. */
double norm_of(const double *x, int count)
{
    double largest = 0.0;
    const double norm = sqrt(dot(x, x, count));
    if (norm > 1e-150 && norm < LARGEST) return norm;
    for (int i = 0; i < count; ++i) largest = larger(largest, fabs(x[i]));
    return largest;
}

/* Rows (count, n) in the free coordinates, times a factor: rows Z^T (count, free). */
static void along(const State *state, const double *rows, int count, double by, double *found)
{
    const int n = state->n, free = state->free;
    for (int i = 0; i < count; ++i)
        for (int j = 0; j < free; ++j)
            found[i * free + j] = by * dot(rows + i * n, state->Z + j * n, n);
}

/* Row i of G in the free coordinates (free). */
static void bound_along(const State *state, int i, double *row)
{
    const int n = state->n;
    if (i >= n) along(state, state->G + i * n, 1, 1.0, row);
    for (int j = 0; i < n && j < state->free; ++j) row[j] = state->Z[j * n + i];
}

/* Turn Z so that its first rows span those of a matrix (k, free), and drop them. */
static void turn(State *state, const Rows *rows, Arena *arena)
{
    const int n = state->n, left = state->free - rows->rank;
    if (left > 0) {
        reflect_rows(rows, state->free, state->Z, n, arena);
        memmove(state->Z, state->Z + rows->rank * n, sizeof(double) * (size_t)(left * n));
    }
    state->free = left;
}

/* Take the span of rows B (count, free), of about unit norm, out of the free directions; B is
 * spent. */
static void narrow(State *state, double *B, int count, double tol, Arena *arena)
{
    const size_t mark = arena->used;
    Rows rows = {0, B, take(arena, state->free), (int *)take(arena, count)};
    rows.rank = reduce(B, count, state->free, tol, rows.beta, rows.order);
    turn(state, &rows, arena);
    arena->used = mark;
}

static void move(State *state, const double *y)
{
    const int n = state->n;
    for (int j = 0; j < state->free; ++j) add_to(state->v, y[j], state->Z + j * n, n);
}

/* What counts as dependent in rows that were divided by `weight`. */
static double resolution(double weight) { return larger(RESOLUTION / weight, ROUNDING); }

/* L (free, free) of a damped level, see cascade.h, for the damping d: L = d (I + C^T C)^-1, which
 * is d (I - C^T (I + C C^T)^-1 C). M holds the rows of C: `held` ones, then the level's. */
static void speed_rows(const Problem *problem, int held, double d, double *L, Arena *arena)
{
    const size_t mark = arena->used;
    const int free = problem->r, all = problem->m - free;
    double *C = take(arena, all * free), *S = take(arena, all * all);
    for (int i = 0; i < all; ++i) {
        const double by = problem->weight * (i < held ? EXCHANGE : 1.0 / d);
        for (int j = 0; j < free; ++j) C[i * free + j] = by * problem->M[i * free + j];
    }
    for (int i = 0; i < all; ++i)
        for (int j = 0; j <= i; ++j)
            S[i * all + j] = dot(C + i * free, C + j * free, free) + (i == j ? 1.0 : 0.0);
    cholesky(S, all);
    for (int i = 0; i < all; ++i) { /* C <- S^-1 C, with what cholesky() makes of S */
        double *row = C + i * free, by = S[i * all + i];
        for (int p = 0; p < i; ++p) add_to(row, -S[i * all + p], C + p * free, free);
        for (int j = 0; j < free; ++j) row[j] *= by;
    }
    for (int i = 0; i < free; ++i) {
        double *row = L + i * free;
        memset(row, 0, sizeof(double) * (size_t)free);
        row[i] = d;
        for (int p = 0; p < all; ++p) add_to(row, -d * C[p * free + i], C + p * free, free);
    }
    arena->used = mark;
}

/* The same inside bounds, where L^T L is d^2 I, or d^2 I + L_m^2 where the speed's damping is more
 * than the level's own, d. */
static void step_rows(const Problem *problem, int held, const Level *level, double *L,
                      Arena *arena)
{
    const size_t mark = arena->used;
    const int free = problem->r;
    const double square = level->damping * level->damping;
    const double more = level->speed * level->speed - square;
    double *S = take(arena, free * free);
    if (more > 0.0) speed_rows(problem, held, sqrt(more), L, arena);
    for (int i = 0; i < free; ++i)
        for (int j = 0; j <= i; ++j)
            S[i * free + j] = (i == j ? square : 0.0) +
                              (more > 0.0 ? dot(L + i * free, L + j * free, free) : 0.0);
    cholesky(S, free);
    for (int i = 0; i < free; ++i) {
        for (int j = 0; j < free; ++j) L[i * free + j] = j < i ? 0.0 : S[j * free + i];
        L[i * free + i] = 1.0 / S[i * free + i];
    }
    arena->used = mark;
}

/* What is missing of a row of `count` numbers at x, divided by the level's norm, as row i of c, and
 * its rounding error, which only bounds ask for; returns row x. */
static double miss(const Problem *problem, const double *row, const double *x, int count, double b,
                   int i, int bounded)
{
    const double by = 1.0 / problem->weight, value = dot(row, x, count);
    double noise = fabs(b);
    for (int p = 0; p < count && bounded; ++p) noise += fabs(row[p] * x[p]);
    problem->c[i] = by * (b - value), problem->noise[i] = EPS * by * noise;
    return by * value;
}

/* What row i of the damped levels above is to be. */
static double held_to(const State *state, const Level *level, int i)
{
    return state->h[i] + (level->damping > 0.0 ? 0.0 : state->shift[i]);
}

/* The speed of a damped level: its rows L (free, free) along Z, and `still` (free), what they are
 * when the speed costs nothing; as rows of M and c from `first` on. */
static void add_speed(const State *state, const Level *level, Problem *problem, int first,
                      double *L, double *still, Arena *arena)
{
    const size_t mark = arena->used;
    const int free = state->free;
    double *speed = take(arena, free), *from = take(arena, free);
    if (level->from == NULL) {
        speed_rows(problem, state->held, level->damping, L, arena);
    } else {
        step_rows(problem, state->held, level, L, arena);
        along(state, level->from, 1, 1.0, from);
    }
    along(state, state->v, 1, 1.0, speed);
    const double by = 1.0 / problem->weight;
    for (int i = 0; i < free * free; ++i) problem->M[first * free + i] = by * L[i];
    for (int i = 0; i < free; ++i) {
        still[i] = level->from == NULL ? 0.0 : dot(L + i * free, from, free);
        miss(problem, L + i * free, speed, free, still[i], first + i, state->N);
    }
    arena->used = mark;
}

/* Make the bounds' rows along Z, unless they are made. */
static void make_bound_rows(const State *state)
{
    BoundRows *made = state->bound_rows;
    const int free = state->free, n = state->n;
    const size_t size = sizeof(double) * (size_t)(free * n);
    if (made->free == free && memcmp(made->Z, state->Z, size) == 0) return;
    made->free = free;
    memcpy(made->Z, state->Z, size);
    for (int i = 0; i < state->N; ++i) {
        double *row = made->rows + i * free;
        bound_along(state, i, row);
        made->squares[i] = dot(row, row, free);
    }
}

/* A level in the free coordinates, heavy rows first: those of the damped levels above, its own, its
 * speed. rows (N) says which bound each row of R is. L (n, n) and still (n) are filled in where the
 * level is damped, see add_speed(). */
void make_problem(const State *state, const Level *level, Problem *problem, double *L,
                  double *still, int *rows, Arena *arena)
{
    const int n = state->n, free = state->free, N = state->N, m = level->m, held = state->held;
    const int damped = level->damping > 0.0 ? free : 0, all = held + m + damped;
    double *M = take(arena, all * free), *c = take(arena, all), *noise = take(arena, all);
    double *R = take(arena, N * free), *lower = take(arena, N), *upper = take(arena, N);
    const double weight = norm_of(level->A, m * n);
    double total = 0.0;
    *problem = (Problem){all, free, 0, M, c, noise, R, lower, upper, weight, 0.0, 0.0};
    if (weight == 0.0) return;
    problem->tol = resolution(weight);
    along(state, state->H, held, 1.0 / weight, M);
    along(state, level->A, m, 1.0 / weight, M + held * free);
    for (int i = 0; i < held; ++i)
        miss(problem, state->H + i * n, state->v, n, held_to(state, level, i), i, N);
    for (int i = 0; i < m; ++i) {
        const double Av = miss(problem, level->A + i * n, state->v, n, level->b[i], held + i, N);
        total += Av * Av;
    }
    problem->scale = norm_of(level->b, m) / weight + sqrt(total);
    if (damped) add_speed(state, level, problem, held + m, L, still, arena);
    if (N > 0) make_bound_rows(state);
    for (int i = 0; i < N; ++i) {
        if (state->lower[i] == -INFINITY && state->upper[i] == INFINITY) continue;
        if (!(state->bound_rows->squares[i] > FIXED * FIXED)) continue;
        const double Gv = bounded(state, state->v, i);
        memcpy(R + problem->k * free, state->bound_rows->rows + i * free, sizeof(double) * (size_t)free);
        lower[problem->k] = smaller(state->lower[i] - Gv, 0.0);
        upper[problem->k] = larger(state->upper[i] - Gv, 0.0);
        rows[problem->k++] = i;
    }
}

/* Later levels are held to what this damped one has reached. */
static void hold(State *state, const Level *level)
{
    const int n = state->n;
    const double by = EXCHANGE * level->damping;
    for (int i = 0; i < level->m; ++i, ++state->held) {
        double *row = state->H + state->held * n;
        for (int p = 0; p < n; ++p) row[p] = level->A[i * n + p] / by;
        state->h[state->held] = dot(row, state->v, n);
        state->shift[state->held] = state->offset == NULL ? 0.0 : dot(row, state->offset, n);
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
 * to round, so that no V comes back. With damping, speed (n, n) is weighed against the sum. */
Route satisfy_rows(State *state, double damping, int max_rounds, double *speed,
                   double *still, double *multipliers, int *rounds, Arena *arena)
{
    const size_t mark = arena->used;
    const int n = state->n, N = state->N;
    double *A = take(arena, N * n), *b = take(arena, N), *upper = state->upper;
    double *over = take(arena, N), *relaxed = take(arena, N), *set = take(arena, N);
    double *lam = take(arena, N), *y = take(arena, n), strong = INFINITY;
    int *V = (int *)take(arena, N), *index = (int *)take(arena, N);
    Route route = CLOSED_FORM;
    for (int i = 0; i < N; ++i) V[i] = 0;
    *rounds = 0;
    for (int round = 0;; ++round) {
        int same = round > 0, m = 0;
        for (int i = 0; i < N; ++i) {
            const double Gv = bounded(state, state->v, i);
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
            double *B = take(arena, count * state->free);
            along(state, A, count, 1.0, B);
            narrow(state, B, count, RESOLUTION, arena);
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
        const Level rows = {m, A, b, damping, damping, NULL, 0};
        make_problem(&open, &rows, &problem, speed, still, index, arena);
        if (overflows(&problem)) {
            route = KEPT;
            break;
        }
        memset(set, 0, sizeof(double) * (size_t)problem.k);
        Face face = make_face(&problem, arena);
        const int used = solve_level(&problem, max_rounds, set, &face, y, lam, arena);
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
        upper[i] = larger(upper[i], bounded(state, state->v, i));
    arena->used = mark;
    return route;
}

/* Take a strict level's rows out of what is free: M (m, free), of unit norm together, which were
 * divided by `weight`; and `count` bounds that are active at every optimum of it. */
static void keep(State *state, const double *M, int m, double weight, const int *bounds, int count,
                 Arena *arena)
{
    const size_t mark = arena->used;
    const int free = state->free;
    double *B = take(arena, (m + count) * free);
    memcpy(B, M, sizeof(double) * (size_t)(m * free));
    for (int i = 0; i < count; ++i)
        bound_along(state, bounds[i], B + (m + i) * free);
    narrow(state, B, m + count, resolution(weight), arena);
    arena->used = mark;
}

/* Hold later levels to what a damped one has just reached exactly, as they are by a strict one;
 * `held` rows were there before it. */
void keep_exactly(State *state, const Level *level, int held, Arena *arena)
{
    const size_t mark = arena->used;
    const double weight = norm_of(level->A, level->m * state->n);
    double *M = take(arena, level->m * state->free);
    state->held = held;
    if (weight > 0.0 && weight < LARGEST) {
        along(state, level->A, level->m, 1.0 / weight, M);
        keep(state, M, level->m, weight, NULL, 0, arena);
    }
    arena->used = mark;
}

/* Speed counts from where a step has led, y (free), in the problem of the next one. */
static void count_from(Problem *problem, const double *y, double *still)
{
    const int free = problem->r, first = problem->m - free;
    for (int i = 0; i < free; ++i) {
        const double *row = problem->M + (first + i) * free, part = dot(row, y, free);
        double noise = 0.0;
        for (int p = 0; p < free; ++p) noise += fabs(row[p] * y[p]);
        still[i] += problem->weight * (part - problem->c[first + i]);
        problem->c[first + i] = part, problem->noise[first + i] = EPS * noise;
    }
}

/* What finds the optimum of a level's problem, step by step. */
typedef struct {
    const Ways *ways;
    Problem *problem;
    const int *index;  /* (k) which bound each row of R is */
    int with_rows;     /* whether M's row space is asked for */
    LeastSquares open; /* the factors of M, once they are needed */
    Face face;
    double *guess; /* (k) */
} Search;

static int any(const double *numbers, int count)
{
    for (int i = 0; i < count; ++i)
        if (numbers[i] != 0.0) return 1;
    return 0;
}

/* The optimum without bounds. */
static void solve_open(Search *search, double *y)
{
    const Problem *problem = search->problem;
    LeastSquares *open = &search->open;
    if (open->M == NULL)
        factor_least_squares(open, problem->M, problem->m, problem->r, problem->tol,
                             search->with_rows);
    least_squares(open, problem->c, y);
}

/* The optimum y and its multipliers once more, out of the bounds that decide it and nothing else: so
 * its last digits do not depend on the way to it. Where joints are at their limits of jerk, they
 * matter after some hundred cycles. Where that is not proved at once, as in degenerate cases, y, its
 * multipliers and the guess stay as they are. */
static void from_deciding(Search *search, double *y, double *lam, Arena *arena)
{
    const size_t mark = arena->used;
    const int r = search->problem->r, k = search->problem->k;
    double *again = take(arena, r), *guess = take(arena, k), *others = take(arena, k);
    for (int i = 0; i < k; ++i) guess[i] = lam[i] > 0.0 ? 1.0 : lam[i] < 0.0 ? -1.0 : 0.0;
    search->face.count = -1;
    if (solve_level(search->problem, 1, guess, &search->face, again, others, arena) == 1) {
        memcpy(y, again, sizeof(double) * (size_t)r);
        memcpy(lam, others, sizeof(double) * (size_t)k);
        memcpy(search->guess, guess, sizeof(double) * (size_t)k);
    }
    arena->used = mark;
}

/* The optimum y (free) of a step, its multipliers lam (k), and its active set (N), which is tried
 * first; then no bound at all; then what a backend proposes, if this is the first step. */
static Route answer(Search *search, int first, double *set, double *y, double *lam, int *rounds,
                    Arena *arena)
{
    const Problem *problem = search->problem;
    const Ways *ways = search->ways;
    const int k = problem->k, most = ways->max_rounds, *index = search->index;
    const int asks = first && ways->propose != NULL;
    double *guess = search->guess;
    int used = 0;
    for (int i = 0; i < k; ++i) guess[i] = set[index[i]];
    if (any(guess, k))
        used = solve_level(problem, asks ? 1 : most, guess, &search->face, y, lam, arena);
    const int searched = first && used != 1;
    if (used > 1 && !any(lam, k)) used = 0; /* by way of bounds that decide nothing: fewer digits */
    if (used <= 0) { /* no guess, or one that was wrong, or so bad that it cost digits */
        solve_open(search, y);
        for (int i = 0; i < k; ++i) guess[i] = lam[i] = set[index[i]] = 0.0;
        if (search->open.rank >= 0 && feasible(problem, y, arena)) return CLOSED_FORM;
        if (asks && ways->propose(ways->backend, ways->level, problem, index, set) < 0)
            return FAILED;
        for (int i = 0; i < k; ++i) guess[i] = set[index[i]];
        used = solve_level(problem, most, guess, &search->face, y, lam, arena);
        if (asks && (used < 0 || !any(lam, k))) { /* with many optima, none proposed */
            memset(guess, 0, sizeof(double) * (size_t)k);
            used = solve_level(problem, most, guess, &search->face, y, lam, arena);
        }
    }
    if (used < 0 && !feasible(problem, y, arena)) { /* where the step began is */
        memset(y, 0, sizeof(double) * (size_t)problem->r);
        memset(lam, 0, sizeof(double) * (size_t)k);
    }
    *rounds += used > 0 ? used : -used;
    if (searched && used > 0 && any(lam, k)) {
        from_deciding(search, y, lam, arena);
        ++*rounds;
    }
    for (int i = 0; i < k; ++i) set[index[i]] = guess[i];
    return used == 1 ? POLISHED : used > 0 ? ACTIVE_SET : UNVERIFIED;
}

/* The active set (N) of a step to try first: the remembered one, or, where the step before it had
 * the same one and has found another since, that. `was` (N): what the step before remembered, and
 * then what this one does. */
static void recall(double *set, int step, double *was, int N)
{
    const size_t size = sizeof(double) * (size_t)N;
    if (step > 0 && memcmp(set, was, size) == 0) {
        memcpy(set, set - N, size);
        return;
    }
    memcpy(was, set, size);
}

/* One level: move to its optimum, and keep A v from now on, exactly or as a damped level does.
 *
 * A damped level is made in `steps`, each from where the one before has led. sets (steps, N): the
 * active set of each to try first, and the one found; a backend is asked in the first step where
 * that is not right at once. *doubt is set where a step before the last is not proved. */
Route descend(State *state, const Level *level, const Ways *ways, int steps, double *sets,
              double *speed, double *still, double *multipliers, int *rounds, int *doubt,
              Arena *arena)
{
    const size_t mark = arena->used;
    const int free = state->free, N = state->N, m = level->m, held = state->held;
    double *y = take(arena, free), *lam = take(arena, N), *was = take(arena, N);
    int *index = (int *)take(arena, N), *strong = (int *)take(arena, N), count = 0;
    Route route = CLOSED_FORM;
    Problem problem;
    if (free == 0 || m == 0) goto done;
    make_problem(state, level, &problem, speed, still, index, arena);
    if (problem.weight == 0.0) goto done;
    if (overflows(&problem)) {
        route = KEPT;
        goto done;
    }
    const int strict = !(level->damping > 0.0) && !level->last, alone = held == 0;
    Search search = {ways, &problem, index, strict && alone,
                     make_least_squares(problem.m, free, arena), make_face(&problem, arena),
                     take(arena, problem.k)};
    for (int step = 0; step < steps; ++step) {
        if (step > 0) count_from(&problem, y, still);
        recall(sets + step * N, step, was, N);
        route = answer(&search, step == 0, sets + step * N, y, lam, rounds, arena);
        if (route == FAILED) goto done;
        if (route == UNVERIFIED && step + 1 < steps) *doubt = 1;
    }
    move(state, y);
    for (int i = 0; i < problem.k; ++i) {
        multipliers[index[i]] = lam[i] * problem.weight * problem.weight;
        if (fabs(lam[i]) > STRONG * problem.scale) strong[count++] = index[i];
    }
    if (level->damping > 0.0)
        hold(state, level);
    else if (strict && alone && route == CLOSED_FORM)
        turn(state, &search.open.rows, arena);
    else if (strict)
        keep(state, problem.M + held * free, m, problem.weight, strong, count, arena);
done:
    arena->used = mark;
    return route;
}

/* Add rows^T (rows v - b), rows (count, n), to the gradient; returns the size of its terms. */
static double add_gradient(const double *rows, const double *b, int count, const double *v, int n,
                           double *gradient)
{
    double square = 0.0, goal = 0.0;
    for (int i = 0; i < count; ++i) {
        const double wanted = b == NULL ? 0.0 : b[i];
        const double residual = dot(rows + i * n, v, n) - wanted;
        add_to(gradient, residual, rows + i * n, n);
        square += residual * residual, goal += wanted * wanted;
    }
    return norm_of(rows, count * n) * sqrt(larger(square, goal));
}

/* Residual of a level's optimality conditions at v, from the problem's own numbers.
 *
 * The larger of: gradient plus G^T multipliers along Z (n, n), its first `free` rows, what was
 * free before the level, and multiplier times slack at the bound of the multiplier's sign, over
 * `small`; both over the size of the gradient's terms, or `small`. The state's held rows are those
 * of the level; L (free, free) and still (free) those of its speed, where it is damped. */
double kkt_residual(const State *state, const Level *level, const double *v, const double *L,
                    const double *still, const double *multipliers, const double *Z, int free,
                    double small, Arena *arena)
{
    const size_t mark = arena->used;
    const int n = state->n;
    double *gradient = take(arena, n), worst = 0.0;
    memset(gradient, 0, sizeof(double) * (size_t)n);
    double scale = add_gradient(level->A, level->b, level->m, v, n, gradient);
    double *speed = take(arena, free), *parts = take(arena, free);
    memset(parts, 0, sizeof(double) * (size_t)free);
    if (level->damping > 0.0) {
        for (int j = 0; j < free; ++j) speed[j] = dot(Z + j * n, v, n);
        scale += add_gradient(L, still, free, speed, free, parts);
    }
    double *held = take(arena, state->held);
    for (int i = 0; i < state->held; ++i) held[i] = held_to(state, level, i);
    const double weight = norm_of(state->H, state->held * n);
    add_gradient(state->H, held, state->held, v, n, gradient);
    scale = larger(scale, small) + HEAVY_NOISE * weight * weight * norm_of(v, n);
    for (int i = 0; i < state->N; ++i) {
        const double lam = multipliers[i];
        if (lam == 0.0) continue;
        const double Gv = bounded(state, v, i);
        for (int p = 0; p < n; ++p) gradient[p] += state->G[i * n + p] * lam;
        const double slack = lam > 0.0 ? state->upper[i] - Gv : Gv - state->lower[i];
        worst = larger(worst, fabs(lam * slack) / small);
    }
    for (int j = 0; j < free; ++j) {
        const double part = parts[j] + dot(Z + j * n, gradient, n);
        if (!(fabs(part) <= worst)) worst = fabs(part);
    }
    arena->used = mark;
    worst /= scale;
    return worst < INFINITY ? worst : INFINITY;
}
