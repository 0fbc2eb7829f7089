/* A textbook unscented Kalman filter (scaled points, alpha = 1, beta = 2, kappa = 0, redrawn before the
   update) for a system whose N, M, K, prepare(), f() and h() are defined before this file is included. */
#include <math.h>
#include <string.h>

#define POINTS (2 * N + 1)

/* lower Cholesky factor of a symmetric matrix; 0 when it is not positive definite */
static int cholesky(int n, const double *restrict A, double *restrict L)
{
    for (int j = 0; j < n; j++) {
        double d = A[j * n + j];
        for (int k = 0; k < j; k++) d -= L[j * n + k] * L[j * n + k];
        if (!(d > 0)) return 0;
        d = sqrt(d);
        L[j * n + j] = d;
        const double inverse = 1 / d;
        for (int i = j + 1; i < n; i++) {
            double s = A[i * n + j];
            for (int k = 0; k < j; k++) s -= L[i * n + k] * L[j * n + k];
            L[i * n + j] = s * inverse;
        }
    }
    return 1;
}

static int draw(const double *restrict x, const double *restrict P, double (*restrict points)[N])
{
    double L[N * N];
    const double c = sqrt((double)N);
    if (!cholesky(N, P, L)) return 0;
    for (int i = 0; i < N; i++) points[0][i] = x[i];
    for (int j = 0; j < N; j++)
        for (int i = 0; i < N; i++) {
            const double d = i < j ? 0 : c * L[i * N + j];
            points[1 + j][i] = x[i] + d;
            points[1 + N + j][i] = x[i] - d;
        }
    return 1;
}

/* Run over T samples. x (N) and P (N, N) are the start, means and stds (T, N) the results.
   Returns the number of samples done: T unless a covariance lost definiteness. */
long run(long T, double dt, const double *inputs, const double *samples, const double *q, const double *r,
         double *x, double *P, double *means, double *stds)
{
    const double w = 0.5 / N;                  /* of every outer point */
    const double wc0 = 0.0 + 1 - 1 + 2;        /* lambda / (n + lambda) + 1 - alpha^2 + beta, lambda = 0 */
    static double points[POINTS][N], moved[POINTS][N], seen[POINTS][M];
    for (long t = 0; t < T; t++) {
        struct known u;
        prepare(inputs + t * K, &u);

        if (!draw(x, P, points)) return t;
        for (int k = 0; k < POINTS; k++) f(points[k], &u, dt, moved[k]);
        for (int i = 0; i < N; i++) x[i] = 0;  /* the centre's weight is zero */
        for (int k = 1; k < POINTS; k++)
            for (int i = 0; i < N; i++) x[i] += w * moved[k][i];
        memset(P, 0, sizeof(double) * N * N);
        for (int k = 0; k < POINTS; k++) {
            const double weight = k ? w : wc0;
            double d[N];
            for (int i = 0; i < N; i++) d[i] = moved[k][i] - x[i];
            for (int i = 0; i < N; i++) {
                const double e = weight * d[i];
                for (int j = 0; j < N; j++) P[i * N + j] += e * d[j];
            }
        }
        for (int i = 0; i < N; i++) P[i * N + i] += q[i] * q[i];

        if (!draw(x, P, points)) return t;
        for (int k = 0; k < POINTS; k++) h(points[k], &u, seen[k]);
        double z[M] = {0}, S[M * M] = {0}, C[N][M], L[M * M], G[N][M];
        for (int k = 1; k < POINTS; k++)
            for (int i = 0; i < M; i++) z[i] += w * seen[k][i];
        memset(C, 0, sizeof C);
        for (int k = 0; k < POINTS; k++) {
            const double weight = k ? w : wc0;
            double d[M];
            for (int i = 0; i < M; i++) d[i] = seen[k][i] - z[i];
            for (int i = 0; i < M; i++) {
                const double e = weight * d[i];
                for (int j = 0; j < M; j++) S[i * M + j] += e * d[j];
            }
            for (int i = 0; i < N; i++) {
                const double e = weight * (points[k][i] - x[i]);
                for (int j = 0; j < M; j++) C[i][j] += e * d[j];
            }
        }
        for (int i = 0; i < M; i++) S[i * M + i] += r[i] * r[i];
        if (!cholesky(M, S, L)) return t;
        double v[M];                            /* L v = innovation, G L' = C */
        for (int j = 0; j < M; j++) {
            double s = samples[t * M + j] - z[j];
            for (int k = 0; k < j; k++) s -= L[j * M + k] * v[k];
            v[j] = s / L[j * M + j];
        }
        for (int j = 0; j < M; j++) {
            const double inverse = 1 / L[j * M + j];
            for (int i = 0; i < N; i++) {
                double s = C[i][j];
                for (int k = 0; k < j; k++) s -= L[j * M + k] * G[i][k];
                G[i][j] = s * inverse;
            }
        }
        for (int i = 0; i < N; i++)
            for (int j = 0; j < M; j++) x[i] += G[i][j] * v[j];
        for (int i = 0; i < N; i++)
            for (int j = 0; j < N; j++) {
                double s = 0;
                for (int k = 0; k < M; k++) s += G[i][k] * G[j][k];
                P[i * N + j] -= s;
            }
        for (int i = 0; i < N; i++) {
            means[t * N + i] = x[i];
            stds[t * N + i] = sqrt(P[i * N + i]);
        }
    }
    return T;
}
