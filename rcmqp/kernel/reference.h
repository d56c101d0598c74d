/* References by equation (5), one at a time; rcmqp/references/view.py says what they are. */
#ifndef RCMQP_REFERENCE_H
#define RCMQP_REFERENCE_H

/* A view: angles and rates about the camera's y, x and z [rad], [rad/s]; along z [m], [m/s]. */
enum { ALPHA, BETA, GAMMA, T_Z, ALPHA_DOT, BETA_DOT, GAMMA_DOT, T_Z_DOT, VIEW_NUMBERS };

void pose_of_view(const double *x_rcm, const double *view, const double *pivot_dot, double *x_d,
                  double *x_d_dot, double *pivot);

#endif
