/* The lexicographic descent: a point, the directions still free, and one level after the other.
 *
 * For convex least squares A_k v is the same at every optimum of level k. So later levels may
 * move in the null space of A_k and nowhere else, which keeps A_k v exactly: v <- v + Z y with Z
 * an orthonormal basis of what is free. y = 0 is always feasible. A bound with a positive
 * multiplier is active at every optimum of its level (complementary slackness), so it leaves Z
 * too; every other bound stays an inequality. This is the null-space form of Escande, Mansard and
 * Wieber (2014), with the bounds above all levels.
 *
 * That is the answer of a strict level. It is exact in every cycle, and jumps between cycles where
 * a singular value or a bound makes a level cheap to serve a little better at great speed. A damped
 * level weighs speed against what it buys. With d its damping, there are two forms.
 *
 * Without bounds, with L = d (I + C^T C)^-1 and C = A Z / d, the A_j Z / d_j of the damped levels
 * above stacked below it,
 *
 *     min |A v - b|^2 + |L Z^T v|^2 + sum |(A_j v - c_j) / exchange_j|^2
 *
 * over what is free, c_j = A_j v_j what the damped levels above have reached. L is an analytic
 * function of A: d in a direction in which nothing is gained, d / (1 + s^2) in one with the
 * singular value s of C. The first two terms of a level alone have eigenvalues of at least
 * 0.889 d^2, so the optimum is unique, and continuous in A, b and Z; v changes by at most 0.81 / d
 * of a change of b. Where nothing is near singular, it is the strict level's answer to s^-6.
 *
 * Inside bounds, where the last v of all levels without bounds, v0, breaks one: a level aims at
 * what it has in v0, and speed is weighed against that, PROXIMAL times:
 *
 *     v_1 = s v0,  v_{i+1} = argmin |A (v - v0)|^2 + d^2 |Z^T (v - v_i)|^2
 *                                   + sum |A_j (v - v_j) / exchange_j|^2
 *
 * with v_j what the damped levels above have reached, and s going from one to zero as v0 leaves the
 * box, so that joints in the way do not drive others that gain nothing. Where joints have limits of
 * acceleration and the bounds keep m of A v0 from the level in the end, the steps are made once more
 * with d^2 + L_m^2 in place of d^2, L_m being L for the damping d sqrt(x), x = (m / d - 5e-5) / 0.006
 * with m / d in rad/s: near the v that serves a blocked level best, d alone would ask for great
 * speeds to and fro, faster than such joints can turn round. These steps aim at A v0 / (1 + y), with
 *
 *     y = x' x / (1 + x),  x' = (sqrt(sum_j (m_j / d_j)^2) - 5e-5) / 0.006, or 0 where that is less,
 *
 * m_j being what the bounds keep from the aim of the damped level j above: the level is asked for its
 * rate now and a little more (approach.c), so nothing would brake a motion that the levels above do
 * not mind, and it would swing.
 *
 * Every step is a projection on a convex set in a norm that changes continuously; where v0 keeps the
 * bounds, all steps stay there. So the answer is continuous through the change from one form to the
 * other too. It is not where hard rows change places with a guarded level (hierarchy.h), where a
 * guarded level cannot be reached inside the box, or with a strict level between damped ones or two
 * strict ones below. In the directions that the bounds leave, a singular
 * value sigma loses (d^2 / (d^2 + sigma^2))^PROXIMAL of what is to be made up for.
 *
 * A damped level takes nothing out of Z; the last term holds later levels to what it has reached.
 * Strict levels below are held to c_j, changed as much as the bounds have changed A_j v.
 */
#ifndef RCMQP_CASCADE_H
#define RCMQP_CASCADE_H

#include "level.h"

/* A direction in which a level gains less at unit speed is left to the levels below: nm/s, or
 * nrad/s, at 1 rad/s [unit of the rows]. */
#define RESOLUTION 1e-9

/* Less than this share of a level's numbers is rounding, whatever the resolution. */
#define ROUNDING 1e-13

/* A bound leaves Z if its multiplier is above this, relative to the level's size. A smaller one
 * stays an inequality, which is never wrong, only more degenerate. */
#define STRONG 1e-7

/* Larger numbers overflow when squared: the level is left alone. */
#define LARGEST 1e150

/* How a level was answered; Route in qp/levels.py, in this order. FAILED, where a backend raised,
 * ends it all. */
typedef enum { CLOSED_FORM, POLISHED, ACTIVE_SET, UNVERIFIED, KEPT, FAILED } Route;

/* A level below moves a damped one by as much as this, times the damping, for each unit of its own
 * residual that it saves. */
#define EXCHANGE 0.003

/* One level: rows A v = b. Strict where damping is zero: later levels keep A v exactly. */
typedef struct {
    int m;
    const double *A; /* (m, n) */
    const double *b; /* (m) */
    double damping;  /* unit of the rows per unit of v */
    double speed;    /* and inside bounds, likewise; the damping, or more */
    const double *from; /* (n) inside bounds, the v from which speed counts; NULL: zero, and L */
    int last;           /* 1 where no level follows, so that what it leaves free is not needed */
} Level;

/* The bounds' rows along the free directions, which most levels have in common. */
typedef struct {
    int free;
    double *Z;       /* (free, n) the directions that they were made for */
    double *rows;    /* (N, free) */
    double *squares; /* (N) of their norms */
} BoundRows;

/* A feasible point and the directions in which it may still move. */
typedef struct {
    int n, N;      /* unknowns; bounds: the box, then the hard rows */
    int free;      /* rows of Z that count */
    double *v;     /* (n) the point */
    double *Z;     /* (n, n) its rows are an orthonormal basis of the free directions */
    double *G;     /* (N, n) the identity, then the hard rows scaled to unit norm */
    double *norms; /* (N) what the rows were divided by: 1 for the box, 0 for zero rows */
    double *lower; /* (N) bounds on G v */
    double *upper; /* (N); after satisfy_rows() with the excess carried */
    int held;      /* rows of the damped levels so far */
    double *H;     /* (held, n) what later levels trade off: each divided by its exchange rate */
    double *h;     /* (held) H v as the damped levels left it */
    double *shift; /* (held) strict levels are held to h plus this: H (v_k - v0), without bounds */
    const double *offset; /* (n) v_k - v0 of the level at hand; NULL without bounds */
    BoundRows *bound_rows;
} State;

/* Asks a backend for the active set of one blocked level: 1 at upper, -1 at lower, 0, in set
 * (N). Returns 0, or -1 where a Python error is set. */
typedef int (*Proposer)(void *backend, int level, const Problem *problem, const int *rows,
                        double *set);

/* How a level's active set is found. */
typedef struct {
    int max_rounds;
    Proposer propose; /* NULL where no backend is asked */
    void *backend;
    int level; /* for the backend */
} Ways;

/* Row i of G times v (n). */
static inline double bounded(const State *state, const double *v, int i)
{
    return i < state->n ? v[i] : dot(state->G + i * state->n, v, state->n);
}

double norm_of(const double *x, int count);

void make_problem(const State *state, const Level *level, Problem *problem, double *L,
                  double *still, int *rows, Arena *arena);

Route satisfy_rows(State *state, double damping, int max_rounds, double *speed,
                   double *still, double *multipliers, int *rounds, Arena *arena);

void keep_exactly(State *state, const Level *level, int held, Arena *arena);

Route descend(State *state, const Level *level, const Ways *ways, int steps, double *sets,
              double *speed, double *still, double *multipliers, int *rounds, int *doubt,
              Arena *arena);

double kkt_residual(const State *state, const Level *level, const double *v, const double *L,
                    const double *still, const double *multipliers, const double *Z, int free,
                    double small, Arena *arena);

#endif
