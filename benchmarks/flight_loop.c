/* The limit of the flight benchmark: the same closed loop, written by hand for this one case.
 *
 * Linear plant with 6 states and 5 inputs, critic with 25 weights (21 quadratic, 4 quartic) learning by Eq. (46) of the
 * paper from 50 stored samples and the current one, classical Runge-Kutta 4, every step kept. Built with -O3.
 */
#include <math.h>
#include <string.h>

enum { N = 6, M = 5, W = 25, S = 50, Y = N + W };

typedef struct {
    const double *A, *B, *RB, *scales, *S, *Q, *regressors, *residuals, *reference, *disturbance;
    double gamma, alpha1, alpha2, eta;
} Loop;

static const int quartic[4] = {0, 1, 3, 4};

static double powers(double e, const Loop *p) {
    double a = fabs(e), s = (e > 0) - (e < 0), low = pow(a, 1 - p->eta);
    return s * ((p->alpha1 + 1) * low + (p->alpha2 + 1) * (a * a / (low + 2.2e-308)));
}

static void rate(double t, const double *y, double *dy, const Loop *p) {
    const double *w = y + N;
    /* reference: rows constant, slope, sine at 0.5 rad/s; disturbance: rows sine, cosine at 0.1 rad/s */
    double s5 = sin(0.5 * t), s1 = sin(0.1 * t), c1 = cos(0.1 * t);
    double z[N], v[N], g[N] = {0}, u[M], drift[N], push[N], sigma[W];
    for (int i = 0; i < N; i++) {
        z[i] = y[i] - (p->reference[i] + p->reference[N + i] * t + p->reference[2 * N + i] * s5);
        v[i] = z[i] / p->scales[i];
    }
    int k = 0;
    for (int i = 0; i < N; i++)
        for (int j = i; j < N; j++, k++) {
            g[i] += w[k] * v[j];
            g[j] += w[k] * v[i];
        }
    for (int i = 0; i < 4; i++) g[quartic[i]] += 4 * w[k + i] * v[quartic[i]] * v[quartic[i]] * v[quartic[i]];
    for (int i = 0; i < M; i++) {
        u[i] = 0;
        for (int j = 0; j < N; j++) u[i] -= 0.5 * p->RB[i * N + j] * g[j] / p->scales[j];
    }
    for (int i = 0; i < N; i++) {
        double a = 0, f = p->disturbance[i] * s1 + p->disturbance[N + i] * c1, d = 0, q = 0;
        for (int j = 0; j < N; j++) {
            a += p->A[i * N + j] * y[j];
            d += p->A[i * N + j] * z[j];
            q += p->S[i * N + j] * g[j];
        }
        for (int j = 0; j < M; j++) f += p->B[i * M + j] * u[j];
        dy[i] = a + f;
        drift[i] = d / p->scales[i] - 0.5 * q;
        push[i] = q;
    }
    double e = 0, square = 1;
    for (int i = 0; i < N; i++) {
        double cost = 0;
        for (int j = 0; j < N; j++) cost += p->Q[i * N + j] * v[j];
        e += v[i] * cost + 0.25 * g[i] * push[i];
    }
    k = 0;
    for (int i = 0; i < N; i++)
        for (int j = i; j < N; j++, k++) sigma[k] = v[j] * drift[i] + v[i] * drift[j];
    for (int i = 0; i < 4; i++) {
        int c = quartic[i];
        sigma[k + i] = 4 * v[c] * v[c] * v[c] * drift[c];
    }
    for (int i = 0; i < W; i++) {
        e += w[i] * sigma[i];
        square += sigma[i] * sigma[i];
    }
    double n = sqrt(square), now = powers(e / n, p) / n, total[W];
    for (int i = 0; i < W; i++) total[i] = now * sigma[i];
    for (int j = 0; j < S; j++) {
        const double *row = p->regressors + j * W;
        double r = p->residuals[j];
        for (int i = 0; i < W; i++) r += row[i] * w[i];
        r = powers(r, p);
        for (int i = 0; i < W; i++) total[i] += r * row[i];
    }
    for (int i = 0; i < W; i++) dy[N + i] = -p->gamma * total[i];
}

void flight(const Loop *p, double h, long steps, double *history) {
    double k1[Y], k2[Y], k3[Y], k4[Y], y[Y];
    for (long step = 0; step < steps; step++) {
        const double *x = history + step * Y;
        double t = step * h, *next = history + (step + 1) * Y;
        rate(t, x, k1, p);
        for (int i = 0; i < Y; i++) y[i] = x[i] + h / 2 * k1[i];
        rate(t + h / 2, y, k2, p);
        for (int i = 0; i < Y; i++) y[i] = x[i] + h / 2 * k2[i];
        rate(t + h / 2, y, k3, p);
        for (int i = 0; i < Y; i++) y[i] = x[i] + h * k3[i];
        rate(t + h, y, k4, p);
        for (int i = 0; i < Y; i++) next[i] = x[i] + h / 6 * (k1[i] + 2 * k2[i] + 2 * k3[i] + k4[i]);
    }
}
