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

/* The largest speed of the next cycle, up to `most`, from which a stop is over after `distance`,
 * this cycle included, for something that goes at v, its last change a, if its deceleration grows
 * with `jerk` up to `deceleration`. If there is no such speed, it is what the jerk alone allows while
 * v > 0, so that something that came too fast stops as soon as the jerk lets it, and what jerk and
 * deceleration allow while it comes back; where a is more than a quarter of the deceleration, it falls
 * faster than by the jerk, in proportion to it. If the jerk allows a change by twice the deceleration in
 * a cycle, it is not counted, nor is the last change. */
double stopping_speed(double v, double a, double distance, double most, double deceleration,
                      double jerk, double T);

/* About the same, mostly to a few per cent, near zero speed less well; in a tenth of the time. */
double about_stopping_speed(double v, double a, double distance, double most, double deceleration,
                            double jerk, double T);

#endif
