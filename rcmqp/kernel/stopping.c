#include "stopping.h"

#include "linalg.h"

#include <math.h>

/* limits/joints.py: nobody sent a command above so many times a limit. */
#define BEYOND 2.0

/* A speed that no joint has; where none is given [rad/s]. */
#define FASTEST 1e6

/* Cuts of a bracket; how narrow it becomes, and how close to the distance, as a share, it ends. */
#define CUTS 100
#define NARROW 1e-14
#define CLOSE 1e-14

#define ROUNDING 1e-12

/* limits/joints.py: braking_speed() */
double braking_speed(double distance, double deceleration, double T)
{
    const double d = fabs(distance), step = deceleration * T;
    double m = floor((sqrt(1.0 + 8.0 * d / (step * T)) - 1.0) / 2.0);
    if (!(m < INFINITY)) m = 0.0;
    return copysign(d / ((m + 1.0) * T) + (m > 0.0 ? m * step / 2.0 : 0.0), distance);
}

/* From here on accelerations are in units of j T, velocities of j T^2, distances of j T^3. */

/* sum_{k >= 1} max(0, |x| - k), with the sign of x */
static double ramp(double x)
{
    const double n = floor(fabs(x));
    return copysign(n * (fabs(x) - 0.5 * (n + 1.0)), x);
}

/* sum_{k >= 1} k max(0, |x| - k), with the sign of x */
static double moment(double x)
{
    const double n = floor(fabs(x));
    return copysign(n * (n + 1.0) * (3.0 * fabs(x) - (2.0 * n + 1.0)) / 6.0, x);
}

/* The corners of a stop that ends at `end`: the deceleration stops to grow, and begins to fall. */
static void corners(double end, double a, double most, double *first, double *second)
{
    *first = *second = 0.5 * (a + end);
    if (0.5 * (end - a) > most) *first = a + most, *second = end - most;
}

/* Speed that a stop takes away. */
static double taken(double end, double a, double most)
{
    double first, second;
    corners(end, a, most, &first, &second);
    return ramp(end) - ramp(second) - ramp(first);
}

/* When the stop from speed v and acceleration a ends; piecewise linear, and solved as such. */
static double end_of_stop(double v, double a, double most)
{
    double guess = a + sqrt(larger(0.0, 4.0 * v + 2.0 * a * (a - 1.0)));
    if (0.5 * (guess - a) > most) guess = (v + ramp(a + most)) / most + 0.5 * (most + 1.0);
    double low = larger(floor(guess), fabs(a)), high = floor(low) + 1.0;
    for (int i = 0; i < CUTS && taken(low, a, most) > v && low > fabs(a); ++i)
        high = low, low = larger(ceil(low) - 1.0, fabs(a));
    for (int i = 0; i < CUTS && taken(high, a, most) < v; ++i) low = high, high += 1.0;
    const double knots[3] = {2.0 * ceil(0.5 * (a + low)) - a, most + ceil(low - most),
                             a + 2.0 * most};
    for (int i = 0; i < 3; ++i)
        if (low < knots[i] && knots[i] < high) {
            if (taken(knots[i], a, most) <= v) low = knots[i];
            else high = knots[i];
        }
    const double least = taken(low, a, most), rise = taken(high, a, most) - least;
    return rise > 0.0 && v > least ? low + (high - low) * smaller(1.0, (v - least) / rise) : low;
}

/* Way of the stop from v and a, this cycle at v included, towards the side to which it goes. */
static double way(double v, double a, double most)
{
    double first, second;
    const double end = end_of_stop(v, a, most);
    corners(end, a, most, &first, &second);
    return moment(end) - moment(second) - moment(first);
}

/* How far up a joint gets that goes on at v, its last change a, and then stops. */
static double reach(double v, double a, double most)
{
    if (v + ramp(a) >= 0.0) return way(v, a, most);
    if (v <= 0.0) return -way(-v, -a, most);
    const double b = a + 0.5; /* v_i = v + i a + i (i + 1) / 2 is positive up to here */
    const double n = floor(larger(0.0, -b - sqrt(larger(0.0, b * b - 2.0 * v))));
    return (n + 1.0) * (v + 0.5 * n * (a + (n + 2.0) / 3.0));
}

/* No less than reach(v, a), and quick: a falls to zero first, then the joint stops from there. */
static double farthest(double v, double a, double most)
{
    const double on = larger(a, 0.0), fastest = v + 0.5 * on * (on + 1.0);
    if (!(fastest > 0.0)) return 0.0;
    return fastest * (on + sqrt(fastest) + 0.5 * fastest / most + 4.0);
}

/* The largest a in [low, high] with reach(v + a, a) <= distance; low if there is none. */
static double highest(double v, double low, double high, double distance, double most)
{
    if (farthest(v + high, high, most) <= distance) return high;
    const double close = CLOSE * larger(1.0, fabs(distance));
    double over = reach(v + high, high, most) - distance;
    if (!(over > 0.0)) return high;
    double under = reach(v + low, low, most) - distance;
    if (under > 0.0) return low;
    for (int i = 0, side = 0; i < CUTS && high - low > NARROW * larger(1.0, fabs(high)); ++i) {
        double middle = low + (high - low) * (under / (under - over)); /* of the secant */
        if (i % 4 == 3 || !(low < middle && middle < high)) middle = low + 0.5 * (high - low);
        const double excess = reach(v + middle, middle, most) - distance;
        if (fabs(excess) <= close) return middle;
        if (excess > 0.0) {
            high = middle, over = excess, under *= side > 0 ? 0.5 : 1.0, side = 1;
        } else {
            low = middle, under = excess, over *= side < 0 ? 0.5 : 1.0, side = -1;
        }
    }
    return low;
}

/* limits/base.py: intersect(); where that leaves nothing, the middle of the two. */
static void intersect(double *low, double *up, double next_low, double next_up)
{
    const double l = clipped(next_low, *low, *up), u = clipped(next_up, *low, *up);
    *low = l > u ? 0.5 * (l + u) : l, *up = l > u ? *low : u;
}

/* A speed that is above V by rounding is V. */
static double rounded(double speed, double V)
{
    return fabs(speed) > V && fabs(speed) <= V * (1.0 + ROUNDING) ? copysign(V, speed) : speed;
}

void joint_interval(const Joint *joint, double v, double a, double below, double above,
                    double *low, double *up)
{
    const double T = joint->period, V = joint->speed, A = joint->acceleration;
    const double top = smaller(V, FASTEST), step = joint->easing * T;
    const double most = smaller(A, 2.0 * BEYOND * top / T);
    if (!(fabs(v) <= BEYOND * top)) v = copysign(top, v), a = 0.0;
    if (!(fabs(a) <= BEYOND * most)) a = 0.0;
    if (!(step < 2.0 * A)) { /* a change of acceleration from one limit to the other is allowed */
        *low = v - T * A, *up = v + T * A;
        intersect(low, up, -V, V);
        intersect(low, up, -braking_speed(below, joint->deceleration, T),
                  braking_speed(above, joint->deceleration, T));
        return;
    }
    a = clipped(a, -most, most);
    *low = larger(a - joint->jerk * T, -A), *up = smaller(a + joint->jerk * T, A);
    intersect(low, up, -braking_speed(V + v, joint->easing, T),
              braking_speed(V - v, joint->easing, T));
    const double soft = joint->deceleration / step, speed = v / (step * T), far = step * T * T;
    const double l = *low / step, u = *up / step;
    intersect(low, up, below < INFINITY ? -step * highest(-speed, -u, -l, below / far, soft) : *low,
              above < INFINITY ? step * highest(speed, l, u, above / far, soft) : *up);
    *low = rounded(v + T * *low, V), *up = rounded(v + T * *up, V);
}

double stopping_speed(double v, double a, double distance, double most, double deceleration,
                      double jerk, double T)
{
    const double step = jerk * T, hardest = deceleration / step;
    if (!(step < 2.0 * deceleration)) return smaller(most, braking_speed(distance, deceleration, T));
    const double change = a / step - 1.0; /* what comes towards the limit too fast may need more */
    const double low = v > 0.0 ? change : larger(change, -hardest);
    const double high = larger(low, (most - v) / (T * step));
    return v + T * step * highest(v / (T * step), low, high, distance / (T * T * step), hardest);
}
