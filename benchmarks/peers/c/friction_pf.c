/* The friction filter of ../friction.py as a SIR particle filter: systematic resampling at each step. */
#include "friction.h"

#include <stdint.h>
#include <stdlib.h>

static uint64_t state[4];

static inline uint64_t rotate(uint64_t x, int k) { return (x << k) | (x >> (64 - k)); }

static uint64_t next(void) /* xoshiro256++, Blackman & Vigna */
{
    const uint64_t result = rotate(state[0] + state[3], 23) + state[0], t = state[1] << 17;
    state[2] ^= state[0];
    state[3] ^= state[1];
    state[1] ^= state[2];
    state[0] ^= state[3];
    state[2] ^= t;
    state[3] = rotate(state[3], 45);
    return result;
}

static double uniform(void) { return (next() >> 11) * 0x1.0p-53; }

static void normal_pair(double *a, double *b) /* Marsaglia's polar method */
{
    double u, v, s;
    do {
        u = 2 * uniform() - 1;
        v = 2 * uniform() - 1;
        s = u * u + v * v;
    } while (s >= 1 || s == 0);
    const double scale = sqrt(-2 * log(s) / s);
    *a = u * scale;
    *b = v * scale;
}

static void seed(uint64_t value) /* splitmix64 */
{
    for (int i = 0; i < 4; i++) {
        uint64_t z = (value += 0x9e3779b97f4a7c15u);
        z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
        z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
        state[i] = z ^ (z >> 31);
    }
}

/* Run over T samples with `count` particles; x (N) and P (N, N, diagonal) are the start. */
long run(long T, const double *inputs, const double *samples, const double *q, const double *r,
         const double *x, const double *P, long count, uint64_t key, double *means, double *stds)
{
    double(*particles)[N] = malloc(sizeof(double) * N * count), (*chosen)[N] = malloc(sizeof(double) * N * count);
    double *weight = malloc(sizeof(double) * count);
    if (!particles || !chosen || !weight) {
        free(particles), free(chosen), free(weight);
        return 0;
    }
    seed(key);
    for (long i = 0; i < count; i++)
        for (int j = 0; j < N; j += 2) {
            double a, b;
            normal_pair(&a, &b);
            particles[i][j] = x[j] + a * sqrt(P[j * N + j]);
            particles[i][j + 1] = x[j + 1] + b * sqrt(P[(j + 1) * N + j + 1]);
        }
    for (long t = 0; t < T; t++) {
        struct known u;
        prepare(inputs + t * K, &u);
        double most = -INFINITY, total = 0;
        for (long i = 0; i < count; i++) {
            for (int j = 0; j < N; j += 2) {
                double a, b;
                normal_pair(&a, &b);
                particles[i][j] += q[j] * a;
                particles[i][j + 1] += q[j + 1] * b;
            }
            double z[M], s = 0;
            h(particles[i], &u, z);
            for (int j = 0; j < M; j++) {
                const double d = (samples[t * M + j] - z[j]) / r[j];
                s -= 0.5 * d * d;
            }
            weight[i] = s;
            if (s > most) most = s;
        }
        for (long i = 0; i < count; i++) total += weight[i] = exp(weight[i] - most);
        double mean[N] = {0}, square[N] = {0};
        for (long i = 0; i < count; i++) {
            weight[i] /= total;
            for (int j = 0; j < N; j++) mean[j] += weight[i] * particles[i][j];
        }
        for (long i = 0; i < count; i++)
            for (int j = 0; j < N; j++) {
                const double d = particles[i][j] - mean[j];
                square[j] += weight[i] * d * d;
            }
        for (int j = 0; j < N; j++) {
            means[t * N + j] = mean[j];
            stds[t * N + j] = sqrt(square[j]);
        }
        const double start = uniform();
        double reached = weight[0];
        for (long i = 0, from = 0; i < count; i++) {
            const double target = (i + start) / count;
            while (reached < target && from < count - 1) reached += weight[++from];
            memcpy(chosen[i], particles[from], sizeof *chosen);
        }
        double(*swap)[N] = particles;
        particles = chosen;
        chosen = swap;
    }
    free(particles), free(chosen), free(weight);
    return T;
}
