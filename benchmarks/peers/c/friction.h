/* Friction of four wheels with Dugoff's tire; see ../friction.py for the equations. */
#include <math.h>
#include <string.h>

#define N 4
#define M 3
#define K 13

static const double MASS = 1412.0, YAW_INERTIA = 1536.7, TO_FRONT = 1.015, TO_REAR = 1.895, TRACK = 1.675;

struct known {
    double cos, sin, X[4], Y[4], share[4];
};

static inline void prepare(const double *u, struct known *k)
{
    k->cos = cos(u[0]);
    k->sin = sin(u[0]);
    for (int i = 0; i < 4; i++) {
        k->X[i] = u[1 + i];
        k->Y[i] = u[5 + i];
        k->share[i] = 0.5 * u[9 + i] / sqrt(k->X[i] * k->X[i] + k->Y[i] * k->Y[i]);
    }
}

static inline void h(const double *restrict x, const struct known *u, double *restrict out)
{
    double X[4], Y[4];
    for (int i = 0; i < 4; i++) {
        const double free = x[i] * u->share[i], ratio = free < 1 ? free : 1, held = ratio * (2 - ratio);
        X[i] = held * u->X[i];
        Y[i] = held * u->Y[i];
    }
    const double x0 = X[0] * u->cos - Y[0] * u->sin, x1 = X[1] * u->cos - Y[1] * u->sin;
    const double front = (X[0] + X[1]) * u->sin + (Y[0] + Y[1]) * u->cos, rear = Y[2] + Y[3];
    out[0] = (x0 + x1 + X[2] + X[3]) / MASS;
    out[1] = (front + rear) / MASS;
    out[2] = (TO_FRONT * front - TO_REAR * rear + 0.5 * TRACK * (x1 - x0 + X[3] - X[2])) / YAW_INERTIA;
}
