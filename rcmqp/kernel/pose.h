/* The pose error of equation (3), e = vec(1 - x* x_d), and how it changes. */
#ifndef RCMQP_POSE_H
#define RCMQP_POSE_H

void see_turn(const double *x, const double *x_d, const double *x_d_dot, double *turn,
              double *turn_dot);

void make_N(const double *J, int n, const double *turn, double *N);

#endif
