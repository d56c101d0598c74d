/* Rows of tasks and limits from one cycle's kinematics, and the objectives: what Task.evaluate(),
 * Limit.evaluate() and Objective.evaluate() of the library call. Their docstrings in rcmqp/tasks
 * and rcmqp/limits derive the formulas. A block is one task, limit or objective, made once of its
 * options.
 */
#ifndef RCMQP_ROWS_H
#define RCMQP_ROWS_H

#include "linalg.h"

/* Tasks, then limits, then objectives. */
typedef enum {
    RCM,       /* period (0: no second order) */
    TIP,
    AT_TROCAR,
    DEPTH,
    ROLL,
    DIRECTION,
    POSE,
    ENTRY,       /* reach */
    ROTATION,    /* the first four rows of POSE */
    ORIENTATION, /* orientation */
    STILL,
    POSTURE,   /* vectors: posture, continuous */
    OBJECTIVE, /* K_c, c_d, objective */
    JOINTS,    /* period, vectors: the JOINT_NUMBERS lines of JointLimits.table */
    TROCAR_CONE,  /* of a damper, half_angle, axis, lever */
    TROCAR_SPEED, /* gain, share, period, vectors: acceleration */
    TROCAR_DEPTH, /* of a damper, last, wrist, bends, shallowest, deepest */
    KEEP_OUT,     /* of a damper, centre, velocity, on_trocar, reach, first, last, wrist, bends */
    KEEP_IN,      /* the same; in both, first is last where only the tip counts */
    ENTRY_SPHERE, /* the same */
    SINGULARITY_PRODUCT, /* vectors: offsets */
    MANIPULABILITY,
    LEAST_SINGULAR_VALUE,
    JOINT_CENTRING, /* vectors: middle, half of the range */
    KINDS,
} Kind;

#define FIRST_LIMIT JOINTS
#define FIRST_OBJECTIVE SINGULARITY_PRODUCT

/* Lines of JointLimits.table: lowest and highest angle of a stop, V, A, j, B, e. */
#define JOINT_NUMBERS 7
enum { LOWEST, HIGHEST, SPEED, ACCELERATION, JERK, BRAKING, EASING };

/* Sides of a cone. */
#define CONE_SIDES 6

/* Most joints of a wrist, see MOST_JOINTS in world/instrument.py; and the numbers of each. */
#define MOST_BENDS 6
#define BEND_NUMBERS 4

/* The options; what a kind does not have is zero. */
typedef struct Block {
    Kind kind;
    double period, K_c, c_d;
    double orientation[4]; /* that the tool is to have in the world */
    double gain, deceleration, jerk; /* of a damper, with the period */
    double share;       /* of the joints' acceleration that holding the trocar may take */
    double half_angle, axis[3];
    double lever;       /* what the cone's rows are multiplied by */
    double shallowest, deepest;
    double centre[3], velocity[3];
    double on_trocar;   /* whether the sphere moves along with the trocar */
    double reach;       /* how near or far the axis may be to the centre, or trocar */
    double first, last; /* ends of the part of the shaft that counts, from the straight tip */
    double bends;       /* joints of a wrist, which are the arm's last ones */
    double wrist[BEND_NUMBERS * MOST_BENDS]; /* of each its axis (3), and how far the next place is */
    const struct Block *objective;
    int n;              /* joints that it is for; 0: any arm */
    double *vectors;    /* (count, n) */
} Block;

/* What a cycle knows. */
typedef struct {
    int n;
    const double *x;         /* (8) effector's pose */
    const double *J;         /* (6, n) its local Jacobian, linear then angular */
    const double *angles;    /* (n) */
    const double *v;         /* (n) joint velocity now */
    const double *a;         /* (n) joint acceleration now */
    const double *x_d;       /* (8) */
    const double *x_d_dot;   /* (8) */
    const double *pivot;     /* (3) */
    const double *pivot_dot; /* (3) */
    double tip;              /* from the effector to the tip, where a wrist is straight */
    const double *x_t;       /* (8) pose of a tool with a wrist; NULL where it is fixed to the shaft */
    const double *J_t;       /* (6, n) its local Jacobian; NULL likewise */
    double R[9], p[3];       /* the effector's placement, from x */
    double R_t[9], p_t[3];   /* the tool's, from x_t */
    double R_d[9], p_d[3], nu_d[3], omega_d[3]; /* the desired one's, and its twist */
    double twist[6], twist_dot[6]; /* of the effector, without its spin about z; see bend.h */
    double spin;
} Cycle;

void see(Cycle *cycle);

int rows_of(const Block *block, int n);

int pieces_of(const Block *block);

void task_rows(const Cycle *cycle, const Block *block, double *A, double *b, double *e,
               Arena *arena);

void limit_rows(const Cycle *cycle, const Block *block, double *lower, double *upper, double *C,
                double *d, Arena *arena);

double pace(double gain, double deceleration, double s);

size_t memory_for_objective(int n);

double objective_value(const Block *block, const double *J, const double *angles, int n,
                       double *gradient, Arena *arena);

/* Of the cycle's geometry: R a and R^T a of a rotation (3, 3); a point of the world seen from the
 * effector; linear and angular part of column j of a Jacobian (6, n); column() takes
 * the cycle's Jacobian. */
static inline void turned(const double *R, const double *a, double *out)
{
    for (int i = 0; i < 3; ++i, R += 3) out[i] = R[0] * a[0] + R[1] * a[1] + R[2] * a[2];
}

static inline void turned_back(const double *R, const double *a, double *out)
{
    for (int i = 0; i < 3; ++i) out[i] = R[i] * a[0] + R[3 + i] * a[1] + R[6 + i] * a[2];
}

static inline void seen(const Cycle *cycle, const double *point, double *out)
{
    double apart[3];
    for (int i = 0; i < 3; ++i) apart[i] = point[i] - cycle->p[i];
    turned_back(cycle->R, apart, out);
}

static inline void column_of(const double *J, int n, int j, double *nu, double *omega)
{
    for (int i = 0; i < 3; ++i) nu[i] = J[i * n + j], omega[i] = J[(3 + i) * n + j];
}

static inline void column(const Cycle *cycle, int j, double *nu, double *omega)
{
    column_of(cycle->J, cycle->n, j, nu, omega);
}

#endif
