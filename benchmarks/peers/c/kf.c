/* The two-state grade filter of ../grade.py, its covariance written out. */
#include <math.h>

long run(long T, double dt, const double *inputs, const double *samples, const double *q, const double *r,
         double *x, double *P, double *means, double *stds)
{
    double v = x[0], g = x[1], a = P[0], b = P[1], c = P[3];
    for (long t = 0; t < T; t++) {
        v += dt * (inputs[t] - g);
        a += dt * (dt * c - 2 * b) + q[0] * q[0];
        b -= dt * c;
        c += q[1] * q[1];
        const double S = a + r[0] * r[0], k0 = a / S, k1 = b / S, e = samples[t] - v;
        v += k0 * e;
        g += k1 * e;
        c -= k1 * b;
        b -= k0 * b;
        a -= k0 * a;
        means[2 * t] = v;
        means[2 * t + 1] = g;
        stds[2 * t] = sqrt(a);
        stds[2 * t + 1] = sqrt(c);
    }
    x[0] = v, x[1] = g;
    P[0] = a, P[1] = P[2] = b, P[3] = c;
    return T;
}
