/* TFOBE's lower layer; see ../tfobe.py for the equations. With HOISTED the cosine and sine of the steer are
   taken once a step, without at every point, as the equations are written. */
#include <math.h>

#define N 15
#define M 7
#define K 9

static const double MASS = 1412.0, YAW_INERTIA = 1536.7, TO_FRONT = 1.015, TO_REAR = 1.895, TRACK = 1.675;
static const double RADIUS = 0.325, WHEEL_INERTIA = 0.9, DRAG = 0.5 * 1.206 * 0.65;

struct known {
    const double *u;
    double cos, sin;
};

static inline void prepare(const double *u, struct known *k)
{
    k->u = u;
    k->cos = cos(u[0]);
    k->sin = sin(u[0]);
}

static inline void body(const double *x, const struct known *u, double *a_x, double *a_y, double *yaw_accel)
{
#ifdef HOISTED
    const double c = u->cos, s = u->sin;
#else
    const double c = cos(u->u[0]), s = sin(u->u[0]);
#endif
    const double *X = x + 7, *Y = x + 11;
    const double x0 = X[0] * c - Y[0] * s, x1 = X[1] * c - Y[1] * s;
    const double front = X[0] * s + Y[0] * c + X[1] * s + Y[1] * c, rear = Y[2] + Y[3];
    *a_x = (x0 + x1 + X[2] + X[3] - DRAG * x[0] * x[0]) / MASS;
    *a_y = (front + rear) / MASS;
    *yaw_accel = (TO_FRONT * front - TO_REAR * rear + 0.5 * TRACK * (x1 - x0 + X[3] - X[2])) / YAW_INERTIA;
}

static inline void f(const double *restrict x, const struct known *u, double dt, double *restrict out)
{
    double a_x, a_y, yaw_accel;
    body(x, u, &a_x, &a_y, &yaw_accel);
    out[0] = x[0] + dt * (a_x + x[1] * x[2]);
    out[1] = x[1] + dt * (a_y - x[0] * x[2]);
    out[2] = x[2] + dt * yaw_accel;
    for (int i = 0; i < 4; i++)
        out[3 + i] = x[3 + i] + dt * (u->u[1 + i] - u->u[5 + i] - RADIUS * x[7 + i]) / WHEEL_INERTIA;
    for (int i = 7; i < N; i++) out[i] = x[i];
}

static inline void h(const double *restrict x, const struct known *u, double *restrict out)
{
    double yaw_accel;
    body(x, u, out, out + 1, &yaw_accel);
    for (int i = 0; i < 5; i++) out[2 + i] = x[2 + i];
}

#include "ukf.h"
