/* Vectors (3) of space and quaternions (4), w first; what is written is neither of the others. */
#ifndef RCMQP_QUATERNION_H
#define RCMQP_QUATERNION_H

static inline void cross(const double *a, const double *b, double *out)
{
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

/* out += a x b */
static inline void add_cross(const double *a, const double *b, double *out)
{
    double product[3];
    cross(a, b, product);
    for (int i = 0; i < 3; ++i) out[i] += product[i];
}

static inline void q_mul(const double *a, const double *b, double *out)
{
    out[0] = a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3];
    out[1] = a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2];
    out[2] = a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1];
    out[3] = a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0];
}

static inline void q_conj(const double *a, double *out)
{
    out[0] = a[0], out[1] = -a[1], out[2] = -a[2], out[3] = -a[3];
}

#endif
