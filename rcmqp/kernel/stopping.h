/* What a joint may do next, so that it can keep its limits ever after; limits/joints.py derives
 * the formulas. */
#ifndef RCMQP_STOPPING_H
#define RCMQP_STOPPING_H

/* Of one joint: period T, speed limit, limits of acceleration and jerk (infinite for none), and
 * the parts of them that are counted on ahead of a limit. */
typedef struct {
    double period, speed, acceleration, jerk, deceleration, easing;
} Joint;

/* Largest speed towards a limit from which a joint can brake short of it, in cycles of T. */
double braking_speed(double distance, double deceleration, double T);

/* low <= v <= up for a joint whose last command was v, its last change a, with so much room left
 * below and above. */
void joint_interval(const Joint *joint, double v, double a, double below, double above,
                    double *low, double *up);

#endif
