/* One step of the surface flow, deposit and all, as fast as C goes: the yardstick of
 * continuum/kernel.py, whose equations, order of actions and order of additions these are, so that
 * without contraction to FMA both give the same bits.
 *
 * Two passes over the cells per sub-step, each with all it needs in registers: the exchange, and what
 * is buried or dug up (one pass for both was slower by a tenth: too long a chain for the processor
 * to overlap cells). Heights have two buffers, for all cells must see those of one instant. The number
 * of species is a constant to the compiler, so that loops over species unroll and those over cells
 * run in lanes.
 * Arrays are (species, cell) as in Python; sealing and reopening of bins go cell by cell.
 */
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#define COURANT 0.25
#define TINY 1e-300
#define MOST_SPECIES 4
#define INLINE static inline __attribute__((always_inline))

typedef struct {
    int64_t species, cells, bins;
    double *height, *rolling, *surface, *filling, *deposit;
    int64_t *top;
    const double *rigid, *rigid_fraction;                             /* Flow */
    const double *repose_slope, *collision_rate, *cross_amplification; /* Law */
    double smoothing, surface_depth, curvature_length;
    double dx, dt, dz; /* Grid */
    const double *velocity, *inflow;
    int64_t steps;
    int64_t substeps; /* written: the sum over all steps */
} Job;

INLINE double larger(double a, double b) { return a > b ? a : b; }

INLINE double smaller(double a, double b) { return a < b ? a : b; }

INLINE double share_of(double c) {
    const double growth = c * (1.0 + c * (0.5 + c * (1.0 / 6.0 + c * (1.0 / 24.0))));
    return growth / (1.0 + growth);
}

INLINE double van_leer(double behind, double ahead) {
    return behind * ahead <= 0.0 ? 0.0 : 2.0 * behind * ahead / (behind + ahead);
}

static void advect_slower(double *thickness, int64_t cells, double nu, double inflow) {
    double arriving = nu * inflow, uphill = inflow, here = thickness[0];
    for (int64_t i = 0; i < cells; i++) {
        double leaving = 0.0, downhill = here;
        if (i < cells - 1) {
            downhill = thickness[i + 1];
            leaving = nu * (here + 0.5 * (1.0 - nu) * van_leer(here - uphill, downhill - here));
        }
        thickness[i] = here + (arriving - leaving);
        arriving = leaving;
        uphill = here;
        here = downhill;
    }
}

static void advect(const Job *job, const double *inflow) {
    double fastest = job->velocity[0];
    for (int64_t a = 1; a < job->species; a++) fastest = larger(fastest, job->velocity[a]);
    for (int64_t a = 0; a < job->species; a++) {
        double *rolling = job->rolling + a * job->cells;
        if (job->velocity[a] == fastest) {
            memmove(rolling + 1, rolling, (size_t)(job->cells - 1) * sizeof(double));
            rolling[0] = inflow[a];
        } else {
            advect_slower(rolling, job->cells, job->velocity[a] / fastest, inflow[a]);
        }
    }
}

INLINE int64_t count_substeps(const Job *job, const int n) {
    double gamma[MOST_SPECIES], fastest = 0.0;
    const double *restrict rolling = job->rolling;
    for (int a = 0; a < n; a++) {
        gamma[a] = job->collision_rate[a * n];
        for (int b = 1; b < n; b++) gamma[a] = larger(gamma[a], job->collision_rate[a * n + b]);
    }
    const int64_t cells = job->cells;
#pragma GCC ivdep
    for (int64_t i = 0; i < cells; i++) {
        double rate = 0.0;
        for (int a = 0; a < n; a++) rate += gamma[a] * rolling[a * cells + i];
        fastest = larger(fastest, rate);
    }
    double climb = fastest * (1.0 + 2.0 * job->curvature_length / job->dx);
    return (int64_t)smaller(larger(1.0, ceil(climb * job->dt / (COURANT * job->dx))), 1e15);
}

static double capacity_of(const Job *job, int64_t i) {
    return job->top[i] == 0 ? job->dz - job->rigid[i] : job->dz;
}

INLINE void seal(const Job *job, int64_t i, const int n) {
    double filled = 0.0;
    for (int a = 0; a < n; a++) filled += job->filling[a * job->cells + i];
    for (double capacity; filled > (capacity = capacity_of(job, i)); filled -= capacity) {
        for (int a = 0; a < n; a++) {
            double *filling = job->filling + a * job->cells + i;
            double sealed = capacity / filled * *filling;
            *filling -= sealed;
            job->deposit[(a * job->cells + i) * job->bins + job->top[i]] = sealed;
        }
        job->top[i]++;
    }
}

INLINE void reopen(const Job *job, int64_t i, double wanted, const int n) {
    while (wanted > 0.0 && job->top[i] > 0) {
        job->top[i]--;
        double *opened = job->deposit + i * job->bins + job->top[i], filled = 0.0;
        const int64_t row = job->cells * job->bins;
        for (int a = 0; a < n; a++) filled += opened[a * row];
        double dug = wanted / larger(wanted, filled);
        for (int a = 0; a < n; a++) {
            double moved = dug * opened[a * row];
            job->surface[a * job->cells + i] += moved;
            job->filling[a * job->cells + i] += opened[a * row] - moved;
            opened[a * row] = 0.0;
        }
        wanted -= filled;
    }
}

INLINE int nearly_full(const Job *job, const double *inflow, const int n) {
    const int64_t cells = job->cells;
    const double *restrict rolling = job->rolling;
    for (int64_t i = 0; i < cells; i++) {
        double arriving = 0.0;
        for (int a = 0; a < n; a++)
            arriving += rolling[a * cells + i] + (i ? rolling[a * cells + i - 1] : inflow[a]);
        if ((double)(job->top[i] + 2) + arriving / job->dz >= (double)job->bins) return 1;
    }
    return 0;
}

/* Bring a cell's surface layer back to depth d; returns by how much what it and the filling bin hold
 * falls short of d (negative) or exceeds d and the bin's capacity (positive). */
INLINE double bury(double *surface, double *filling, double depth, double capacity, const int n) {
    double held = surface[0], filled = filling[0];
    for (int a = 1; a < n; a++) held += surface[a], filled += filling[a];
    const double excess = held - depth, above = excess + filled;
    const double from = larger(larger(excess > 0.0 ? held : filled, fabs(excess)), TINY);
    const double share = excess / from;
    for (int a = 0; a < n; a++) {
        double moved = share * (excess > 0.0 ? surface[a] : filling[a]);
        surface[a] -= moved;
        filling[a] += moved;
    }
    return smaller(above, 0.0) + larger(above - capacity, 0.0);
}

/* One sub-step of all cells but the last; heights are read from `before` (1 cell of padding on
 * either side) and written to `after`. `crossing` (cell,): see bury(). */
INLINE void substep(const Job *job, const double *restrict before, double *restrict after,
                    double *restrict crossing, double dt, const int smooth, const int n) {
    const int64_t cells = job->cells;
    const double per_dx = 1.0 / job->dx, curvature = job->curvature_length / job->dx;
    const double depth = job->surface_depth, dt_per_depth = dt / depth;
    const double w2 = job->smoothing * job->smoothing;
    double *restrict rolling = job->rolling, *restrict surface = job->surface;
    double *restrict filling = job->filling;
    const double *restrict rigid = job->rigid, dz = job->dz;
    const int64_t *restrict top = job->top;
    double repose[MOST_SPECIES * MOST_SPECIES], gamma[MOST_SPECIES * MOST_SPECIES];
    double mu[MOST_SPECIES * MOST_SPECIES], rigid_fraction[MOST_SPECIES];
    for (int k = 0; k < n * n; k++) {
        repose[k] = job->repose_slope[k];
        gamma[k] = job->collision_rate[k];
        mu[k] = job->cross_amplification[k];
    }
    for (int a = 0; a < n; a++) rigid_fraction[a] = job->rigid_fraction[a];
#pragma GCC ivdep
    for (int64_t i = 0; i < cells - 1; i++) {
        double r[MOST_SPECIES], s[MOST_SPECIES], phi[MOST_SPECIES];
        double pull[MOST_SPECIES], push[MOST_SPECIES], left[MOST_SPECIES];
        const double theta = (before[i] - before[i + 1]) * per_dx;
        const double uphill = (before[i - 1] - before[i]) * per_dx;
        const double slope = theta - curvature * (uphill - theta);
        double risen = 0.0;
#pragma GCC unroll 4
        for (int a = 0; a < n; a++) {
            r[a] = rolling[a * cells + i];
            s[a] = surface[a * cells + i];
        }
        double held = s[0];
        for (int a = 1; a < n; a++) held += s[a];
        const double bare = larger(depth - held, 0.0), per_held = 1.0 / larger(held, depth);
        for (int a = 0; a < n; a++) phi[a] = (s[a] + bare * rigid_fraction[a]) * per_held;
        for (int a = 0; a < n; a++) {
            double z = repose[a * n] * phi[0];
            for (int b = 1; b < n; b++) z += repose[a * n + b] * phi[b];
            z -= slope;
            if (smooth) {
                const double size = sqrt(z * z + w2);
                pull[a] = 0.5 * (z + size);
                push[a] = 0.5 * (size - z);
            } else {
                pull[a] = larger(z, 0.0);
                push[a] = larger(-z, 0.0);
            }
        }
        for (int a = 0; a < n; a++) {
            double amplified = 0.0;
            for (int b = 0; b < n; b++)
                amplified += (mu[b * n + a] + gamma[b * n + a] * push[b]) * r[b];
            const double settled = share_of(gamma[a * n + a] * pull[a] * dt) * r[a] -
                                   share_of(amplified * dt_per_depth) * s[a];
            left[a] = r[a] - settled;
            s[a] += settled;
            risen = a ? risen + settled : settled;
        }
        after[i] = before[i] + risen;
        for (int a = 0; a < n; a++) {
            rolling[a * cells + i] = left[a];
            surface[a * cells + i] = s[a];
        }
    }
#pragma GCC ivdep
    for (int64_t i = 0; i < cells - 1; i++) {
        double s[MOST_SPECIES], f[MOST_SPECIES];
        for (int a = 0; a < n; a++) {
            s[a] = surface[a * cells + i];
            f[a] = filling[a * cells + i];
        }
        crossing[i] = bury(s, f, depth, dz - (top[i] == 0 ? rigid[i] : 0.0), n);
        for (int a = 0; a < n; a++) {
            surface[a * cells + i] = s[a];
            filling[a * cells + i] = f[a];
        }
    }
}

INLINE void wall(const Job *job, const double *before, double *after, double *crossing, double share,
                 const int n) {
    const int64_t last = job->cells - 1;
    double s[MOST_SPECIES], f[MOST_SPECIES], risen = 0.0;
    for (int a = 0; a < n; a++) {
        double *rolling = job->rolling + a * job->cells + last;
        double settled = *rolling * share;
        *rolling -= settled;
        risen = a ? risen + settled : settled;
        s[a] = job->surface[a * job->cells + last] + settled;
        f[a] = job->filling[a * job->cells + last];
    }
    after[last] = before[last] + risen;
    crossing[last] = bury(s, f, job->surface_depth, capacity_of(job, last), n);
    for (int a = 0; a < n; a++) {
        job->surface[a * job->cells + last] = s[a];
        job->filling[a * job->cells + last] = f[a];
    }
}

INLINE void dig_up(const Job *job, const double *restrict crossing, const int n) {
    int64_t lacking = 0;
    for (int64_t i = 0; i < job->cells; i++) lacking += crossing[i] < 0.0;
    if (!lacking) return;
    for (int64_t i = 0; i < job->cells; i++)
        if (crossing[i] < 0.0) reopen(job, i, -crossing[i], n);
}

INLINE void seal_full_bins(const Job *job, const double *restrict crossing, const int n) {
    for (int64_t i = 0; i < job->cells; i++)
        if (crossing[i] > 0.0) seal(job, i, n);
}

INLINE int64_t advance(Job *job, const int n) {
    const size_t row = ((size_t)job->cells + 2 + 15) / 8 * 8;
    double *work = aligned_alloc(64, 3 * row * sizeof(double));
    double *height = work + 8, *other = work + row + 8, *crossing = work + 2 * row;
    int64_t step = 0;
    memcpy(height, job->height, (size_t)job->cells * sizeof(double));
    for (; step < job->steps; step++) {
        const double *inflow = job->inflow + step * n;
        if (nearly_full(job, inflow, n)) break;
        advect(job, inflow);
        const int64_t substeps = count_substeps(job, n);
        job->substeps += substeps;
        for (int64_t k = 0; k < substeps; k++) {
            height[-1] = height[0] + (height[0] - height[1]);
            if (job->smoothing == 0.0)
                substep(job, height, other, crossing, job->dt / (double)substeps, 0, n);
            else
                substep(job, height, other, crossing, job->dt / (double)substeps, 1, n);
            wall(job, height, other, crossing, 1.0 / (double)(substeps - k), n);
            dig_up(job, crossing, n);
            double *swap = height;
            height = other;
            other = swap;
        }
        seal_full_bins(job, crossing, n);
    }
    memcpy(job->height, height, (size_t)job->cells * sizeof(double));
    free(work);
    return step;
}

/* Take `job->steps` steps, fewer where the deposit needs more bins; returns how many were taken,
 * -1 for more species than were compiled for. */
int64_t advance_flow(Job *job) {
    switch (job->species) {
        case 1: return advance(job, 1);
        case 2: return advance(job, 2);
        case 3: return advance(job, 3);
        case 4: return advance(job, 4);
        default: return -1;
    }
}

/* Twelve chains of 8 lanes, each multiplied and added to `repeats` times: what the machine can do. */
double multiply_and_add(int64_t repeats) {
    typedef double Lanes __attribute__((vector_size(64)));
    Lanes x[12], sum = {0.0};
    for (int j = 0; j < 12; j++) x[j] = sum + (double)(j + 1);
    for (int64_t k = 0; k < repeats; k++)
#pragma GCC unroll 12
        for (int j = 0; j < 12; j++) x[j] = x[j] * 0.999 + 0.001;
    for (int j = 0; j < 12; j++) sum += x[j];
    return sum[0];
}
