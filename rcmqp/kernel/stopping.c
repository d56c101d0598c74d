#include "stopping.h"

#include "linalg.h"

#include <math.h>

/* limits/joints.py: nobody sent a command above so many times a limit. */
#define BEYOND 2.0

/* A speed that no joint has; where none is given [rad/s]. */
#define FASTEST 1e6

/* Cuts of a bracket, from which on only by half, how narrow it becomes, and how close to the
 * distance, as a share, a search ends; steps of about_stopping_speed(), and of hit(). */
#define CUTS 100
#define PATIENCE 12
#define NARROW 1e-14
#define CLOSE 1e-14
#define GUESSES 4
#define STEPS 6

/* An acceleration towards a limit, over the hardest deceleration, falls so many times as fast as a
 * stop grows, if that is faster; but not beyond that deceleration within a cycle. */
#define EAGER 4.0

#define ROUNDING 1e-12

/* maths/smooth.py: braking_speed() */
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

/* About when the stop from speed v and acceleration a ends. */
static double guess_of_end(double v, double a, double most)
{
    const double guess = a + sqrt(larger(0.0, 4.0 * v + 2.0 * a * (a - 1.0)));
    return 0.5 * (guess - a) > most ? (v + ramp(a + most)) / most + 0.5 * (most + 1.0) : guess;
}

/* When it ends; piecewise linear, and solved as such. */
static double end_of_stop(double v, double a, double most)
{
    const double guess = guess_of_end(v, a, most);
    double low = larger(floor(guess), fabs(a)), high = floor(low) + 1.0;
    double least = taken(low, a, most), greatest = taken(high, a, most);
    for (int i = 0; i < CUTS && least > v && low > fabs(a); ++i) {
        high = low, greatest = least, low = larger(ceil(low) - 1.0, fabs(a));
        least = taken(low, a, most);
    }
    for (int i = 0; i < CUTS && greatest < v; ++i) {
        low = high, least = greatest, high += 1.0;
        greatest = taken(high, a, most);
    }
    const double knots[3] = {2.0 * ceil(0.5 * (a + low)) - a, most + ceil(low - most),
                             a + 2.0 * most};
    for (int i = 0; i < 3; ++i)
        if (low < knots[i] && knots[i] < high) {
            const double between = taken(knots[i], a, most);
            if (between <= v) low = knots[i], least = between;
            else high = knots[i], greatest = between;
        }
    const double rise = greatest - least;
    return rise > 0.0 && v > least ? low + (high - low) * smaller(1.0, (v - least) / rise) : low;
}

/* Way of a stop, its first cycle included. */
static double way(double end, double a, double most)
{
    double first, second;
    corners(end, a, most, &first, &second);
    return moment(end) - moment(second) - moment(first);
}

/* How far up a joint gets that goes on at v, its last change a, and then stops. */
static double reach(double v, double a, double most)
{
    if (v + ramp(a) >= 0.0) return way(end_of_stop(v, a, most), a, most);
    if (v <= 0.0) return -way(end_of_stop(-v, -a, most), -a, most);
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

/* reach(v + a, a) of time that is not cut into cycles, for motions that go on, and its derivative by
 * a: first a falls to zero, or is taken as a part of a stop that has begun. */
static double smooth_reach(double v, double a, double most, double *slope)
{
    const double now = v + a, peak = larger(now + 0.5 * a * a, 0.0), root = sqrt(peak);
    const double way = peak < most * most ? peak * root : 0.5 * peak * (peak / most + most);
    const double rise = peak < most * most ? 1.5 * root : peak / most + 0.5 * most;
    *slope = rise * (1.0 + a) + now + a + a * a;
    return way + a * now + a * a * a / 3.0;
}

/* About the largest a with smooth_reach(v, a) <= distance, in [low, high], by so many steps from a
 * guess on; and the slope about there. */
static double smooth_highest(double v, double low, double high, double distance, double most,
                             int steps, double *slope)
{
    const double half = 0.5 * most * most;
    const double peak = distance < most * most * most
                            ? cbrt(distance * distance)
                            : sqrt(half * half + 2.0 * distance * most) - half;
    double a = clipped(sqrt(larger(0.0, 1.0 + 2.0 * (peak - v))) - 1.0, low, high);
    for (int i = 0; i < steps; ++i) {
        const double excess = smooth_reach(v, a, most, slope) - distance;
        if (!(*slope > 0.0)) break;
        a = clipped(a - excess / *slope, low, high);
    }
    return a;
}

/* Whether a with reach(v + a, a) = distance is found from a guess on. Where something only slows down,
 * the speed that its stop takes away and the way of it are linear in a and in the end of the stop, as
 * long as the end and both corners stay between the same whole numbers: then one step of Newton's method
 * is exact. */
static int hit(double v, double distance, double most, double *a)
{
    double end = guess_of_end(v + *a, *a, most), first, second, piece[3] = {INFINITY, INFINITY, INFINITY};
    for (int i = 0; i < STEPS; ++i) {
        corners(end, *a, most, &first, &second);
        const double whole[3] = {trunc(end), trunc(second), trunc(first)};
        if (whole[0] == piece[0] && whole[1] == piece[1] && whole[2] == piece[2])
            return end >= fabs(*a) && v + *a + ramp(*a) >= 0.0;
        const double n = fabs(whole[0]), m = fabs(whole[1]), k = fabs(whole[2]);
        const double speed = taken(end, *a, most) - (v + *a), excess = way(end, *a, most) - distance;
        const double speed_by_a = -k - 1.0, way_by_a = -0.5 * k * (k + 1.0);
        const double speed_by_end = n - m, way_by_end = 0.5 * (n * (n + 1.0) - m * (m + 1.0));
        const double det = speed_by_a * way_by_end - speed_by_end * way_by_a;
        *a -= (speed * way_by_end - excess * speed_by_end) / det;
        end -= (excess * speed_by_a - speed * way_by_a) / det;
        for (int j = 0; j < 3; ++j) piece[j] = whole[j];
    }
    return 0;
}

/* The largest a in [low, high] with reach(v + a, a) <= distance; low if there is none.
 *
 * Where Newton's method does not hit it: from a guess on, by secants, kept between what is known to be
 * too low and too high; now and then by half. */
static double highest(double v, double low, double high, double distance, double most)
{
    const double close = CLOSE * larger(1.0, fabs(distance)), least = low, greatest = high;
    if (farthest(v + high, high, most) <= distance) return high;
    double slope, a = smooth_highest(v, low, high, larger(distance, 0.0), most, 1, &slope), found = a;
    if (low < a && a < high && hit(v, distance, most, &found) && low <= found && found <= high)
        return found;
    double before = 0.0, excess_before = 0.0;
    for (int i = 0; i < CUTS && high - low > NARROW * larger(1.0, fabs(high)); ++i) {
        const double excess = reach(v + a, a, most) - distance;
        if ((a == greatest && !(excess > 0.0)) || (a == least && excess > 0.0)) return a;
        if (fabs(excess) <= close) return a;
        if (excess > 0.0) high = a;
        else low = a;
        const double rise = i > 0 ? (excess - excess_before) / (a - before) : slope;
        before = a, excess_before = excess;
        a -= excess / (rise > 0.0 ? rise : slope);
        if (!(a > low)) a = low == least && before != least ? least : 0.5 * (low + high);
        if (!(a < high)) a = high == greatest && before != greatest ? greatest : 0.5 * (low + high);
        if (i % 4 == 3 || i >= PATIENCE) a = 0.5 * (low + high);
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

/* Accelerations of the next cycle that a stop from v, its last change a, allows, up to the speed
 * `most`; all in cycles. What comes towards the limit too fast may need more than the hardest. */
static double least_change(double v, double a, double hardest)
{
    const double eager = smaller(EAGER * a / hardest, a + hardest);
    const double change = a - larger(1.0, eager);
    return v > 0.0 ? change : larger(change, -hardest);
}

/* The same in cycles: v, and the least and greatest a of the next one. */
typedef struct {
    double unit, now, low, high, far, hardest;
} Stop;

static Stop in_cycles(double v, double a, double distance, double most, double deceleration,
                      double jerk, double T)
{
    const double step = jerk * T, unit = T * step, hardest = deceleration / step;
    const double low = least_change(v, a / step, hardest);
    return (Stop){unit, v / unit, low, larger(low, (most - v) / unit), distance / (T * unit), hardest};
}

double stopping_speed(double v, double a, double distance, double most, double deceleration,
                      double jerk, double T)
{
    if (!(jerk * T < 2.0 * deceleration))
        return smaller(most, braking_speed(distance, deceleration, T));
    const Stop stop = in_cycles(v, a, distance, most, deceleration, jerk, T);
    return v + stop.unit * highest(stop.now, stop.low, stop.high, stop.far, stop.hardest);
}

double about_stopping_speed(double v, double a, double distance, double most, double deceleration,
                            double jerk, double T)
{
    if (!(jerk * T < 2.0 * deceleration))
        return smaller(most, braking_speed(distance, deceleration, T));
    const Stop stop = in_cycles(v, a, distance, most, deceleration, jerk, T);
    double slope;
    if (farthest(stop.now + stop.high, stop.high, stop.hardest) <= stop.far)
        return v + stop.unit * stop.high;
    return v + stop.unit * smooth_highest(stop.now, stop.low, stop.high, larger(stop.far, 0.0),
                                          stop.hardest, GUESSES, &slope);
}
