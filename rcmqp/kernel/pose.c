#include "pose.h"

#include "dualquaternion.h"
#include "linalg.h"

/* turn (8) = x* x_d and turn_dot (8) = x* x_d', with x_d on x's side. */
void see_turn(const double *x, const double *x_d, const double *x_d_dot, double *turn,
              double *turn_dot)
{
    const double side = dot(x, x_d, 4) < 0.0 ? -1.0 : 1.0;
    double x_conj[8], z[8];
    dq_conj(x, x_conj);
    for (int i = 0; i < 8; ++i) z[i] = side * x_d[i];
    dq_mul(x_conj, z, turn);
    for (int i = 0; i < 8; ++i) z[i] = side * x_d_dot[i];
    dq_mul(x_conj, z, turn_dot);
}

/* N (8, n) = H-(x_d) C_8 J_dq of equation (3), without J_dq: with z = x* x_d, the twists (nu,
 * omega) in J's columns (6, n) give N v = vec(conj(x') x_d) = -vec((omega + eps nu) z) / 2. */
void make_N(const double *J, int n, const double *turn, double *N)
{
    double twist[8] = {0.0}, column[8];
    for (int j = 0; j < n; ++j) {
        for (int i = 0; i < 3; ++i) {
            twist[1 + i] = -0.5 * J[(3 + i) * n + j];
            twist[5 + i] = -0.5 * J[i * n + j];
        }
        dq_mul(twist, turn, column);
        for (int i = 0; i < 8; ++i) N[i * n + j] = column[i];
    }
}
