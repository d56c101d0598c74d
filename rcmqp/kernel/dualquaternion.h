/* Dual quaternions (8), w first, one at a time; rcmqp/maths/dualquaternion.py says the same in
 * numpy. */
#ifndef RCMQP_DUALQUATERNION_H
#define RCMQP_DUALQUATERNION_H

void dq_mul(const double *x, const double *y, double *out);

void dq_conj(const double *x, double *out);

void dq_translation(const double *x, double *t);

void dq_of_xyzquat(const double *placement, double *x);

void dq_carry(const double *x, const double *offset, double share, double *out);

void dq_rate(const double *x, const double *twist, const double *drift, double *x_dot);

#endif
