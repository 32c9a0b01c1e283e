/* The rate rule in a silo as fast as C goes: the yardstick of ca_model/rates/kernel.py. The same
 * words of SplitMix64 in the same order and the same doubles (no contraction to FMA but where it is
 * written, as division by a constant, whose rounding it keeps), so the very same grains.
 *
 * All columns meet the heights with which a sub-step begins, so what does not hang on the random
 * words is found first, eight columns in the lanes of a register: chances, and by how likely none of
 * so many grains is captured or set rolling, (1 - p)^n. What is left, column after column, is a word
 * for each draw and a comparison; only where a grain moves is there more to do.
 *
 * Arrays are (rank, column) as in the kernel; the smallest rank is 0.
 */
#include <immintrin.h>
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#define COURANT 0.25
#define CERTAIN 40.0
#define MOST_AT_ONCE 16.0
#define MOST_RANKS 4
#define LANES 8
#define NO_DRAW 2.0     /* as a probability that nothing moves: no word is drawn */
#define UNCOMMON (-1.0) /* certain, likelier than not, or of so many that several are drawn */
#define GOLDEN 0x9E3779B97F4A7C15u
#define INLINE static inline __attribute__((always_inline))
#define LIKELY(x) __builtin_expect(!!(x), 1)

typedef double Reals __attribute__((vector_size(64)));
typedef int64_t Wholes __attribute__((vector_size(64)));

typedef struct {
    int64_t ranks, columns, places, steps;
    int64_t *height;  /* (column,) */
    int64_t *rolling; /* (rank, column) */
    int64_t *layer;   /* (rank, column) */
    int64_t *grains;  /* (column,) in the stack */
    int8_t *stack;    /* (column, place) */
    uint64_t *random;
    const int64_t *arrivals; /* (step, rank) */
    const int64_t *grain_height;
    const double *repose_slope, *collision_rate, *cross_amplification; /* (rank, rank) */
    const double *rigid_fraction, *fastest;
    double smoothing, curvature_length, sharpness, amplification, unit, width, step;
    int64_t contacts, depth;
    int64_t exchanges; /* written: columns in which something rolled, over all sub-steps */
} Job;

typedef struct {
    int64_t columns, places, contacts, depth, tallest, tall[MOST_RANKS];
    double repose[MOST_RANKS][MOST_RANKS], gamma[MOST_RANKS][MOST_RANKS];
    double mu[MOST_RANKS][MOST_RANKS], rigid[MOST_RANKS];
    double smoothing, curvature, steepness, sharpness, amplification, unit;
    int64_t *height, *rolling[MOST_RANKS], *layer[MOST_RANKS], *grains;
    double *chance[2 * MOST_RANKS], *none[2 * MOST_RANKS]; /* of capture, then of setting rolling */
    int8_t *stack;
    uint64_t random;
} Pile;

/* ---- random numbers ---- */

INLINE uint64_t mixed(uint64_t bits) {
    bits = (bits ^ (bits >> 30)) * 0xBF58476D1CE4E5B9u;
    bits = (bits ^ (bits >> 27)) * 0x94D049BB133111EBu;
    return bits ^ (bits >> 31);
}

INLINE double real_of(uint64_t bits) { return (double)(int64_t)(bits >> 11) * 0x1p-53; }

INLINE double power(double base, int64_t exponent) {
    double power = 1.0;
    for (; exponent; exponent >>= 1, base *= base)
        if (exponent & 1) power *= base;
    return power;
}

/* How many of n, when the word is `left`, and none with the probability `weight`. */
INLINE int64_t inverted(double left, double weight, int64_t n, double chance) {
    const double odds = chance / (1.0 - chance);
    int64_t k = 0;
    while (left >= weight && k < n) {
        left -= weight;
        k++;
        weight *= odds * (double)(n - k + 1) / (double)k;
    }
    return k;
}

static __attribute__((noinline)) int64_t uncommon(uint64_t *random, int64_t n, double chance) {
    if (chance >= 1.0) return n;
    const double rare = chance < 1.0 - chance ? chance : 1.0 - chance;
    const int64_t most = (double)n * rare <= MOST_AT_ONCE ? n : (int64_t)(MOST_AT_ONCE / rare);
    int64_t happened = 0;
    for (int64_t left = n; left > 0;) {
        const int64_t part = left < most ? left : most;
        const double word = real_of(mixed(*random += GOLDEN));
        happened += inverted(word, power(1.0 - rare, part), part, rare);
        left -= part;
    }
    return rare == chance ? happened : n - happened;
}

/* ---- chances, in lanes ---- */

INLINE Reals all(double value) { return (Reals)_mm512_set1_pd(value); }
INLINE Wholes loaded(const int64_t *from) { return (Wholes)_mm512_loadu_si512(from); }
INLINE void store(double *to, Reals values) { _mm512_storeu_pd(to, (__m512d)values); }
INLINE Reals reals(Wholes values) { return __builtin_convertvector(values, Reals); }
INLINE Wholes fewer(Wholes a, Wholes b) { return (Wholes)_mm512_min_epi64((__m512i)a, (__m512i)b); }
INLINE Wholes more(Wholes a, Wholes b) { return (Wholes)_mm512_max_epi64((__m512i)a, (__m512i)b); }
INLINE Reals choose(Wholes where, Reals there, Reals elsewhere) {
    return (Reals)_mm512_mask_blend_pd(_mm512_movepi64_mask((__m512i)where), (__m512d)elsewhere,
                                       (__m512d)there);
}
INLINE int some(Wholes where) { return _mm512_movepi64_mask((__m512i)where) != 0; }

/* y / divisor, rounded as the division is: the quotient by the reciprocal, and what it lacks. */
INLINE Reals over(Reals y, double divisor) {
    const Reals part = all(1.0 / divisor), quotient = y * part;
    const __m512d lacks = _mm512_fnmadd_pd((__m512d)quotient, (__m512d)all(divisor), (__m512d)y);
    return (Reals)_mm512_fmadd_pd(lacks, (__m512d)part, (__m512d)quotient);
}

INLINE Reals chance_within(Reals expected) {
    const Reals y = expected * 0.0625;
    Reals grown = 1.0 + y * (1.0 + y * 0.5 *
                  (1.0 + over(y, 3) * (1.0 + y * 0.25 * (1.0 + over(y, 5) * (1.0 + over(y, 6))))));
    grown *= grown;
    grown *= grown;
    grown *= grown;
    grown *= grown;
    return choose(expected > CERTAIN, all(1.0), (grown - 1.0) / grown);
}

INLINE Reals positive(Reals z, double smoothing) {
    if (smoothing == 0.0) return choose(z > 0.0, z, all(0.0));
    return 0.5 * (z + (Reals)_mm512_sqrt_pd((__m512d)(z * z + smoothing * smoothing)));
}

/* Put down how likely an event that is `expected` so often is, and that none of n has it. */
INLINE void put_down(Pile *pile, int draw, int64_t i, Reals expected, Wholes n) {
    const Wholes drawn = (expected > 0.0) & (n > 0);
    Reals none = all(NO_DRAW);
    if (some(drawn)) {
        const Reals chance = chance_within(expected);
        const Wholes common = (chance <= 0.5) & (reals(n) * chance <= MOST_AT_ONCE);
        const int64_t largest = _mm512_reduce_max_epi64((__m512i)n);
        Reals base = 1.0 - chance, power = all(1.0);
        for (int64_t bit = 1; bit <= largest; bit <<= 1, base *= base)
            power = choose((n & bit) != 0, power * base, power);
        none = choose(drawn & (chance > 0.0), choose(common, power, all(UNCOMMON)), none);
        store(pile->chance[draw] + i, chance);
    }
    store(pile->none[draw] + i, none);
}

/* Eight columns from i on; whether anything rolls there. */
INLINE int find_chances(Pile *pile, int64_t i, double dt, const int N) {
    Wholes rolling[N], layer[N], rolls = (Wholes){0}, held = rolls;
    for (int a = 0; a < N; a++) {
        rolling[a] = loaded(pile->rolling[a] + i);
        rolls |= rolling[a];
    }
    if (!some(rolls != 0)) return 0;
    for (int a = 0; a < N; a++) {
        layer[a] = loaded(pile->layer[a] + i);
        held += layer[a] * pile->tall[a];
    }
    const Wholes nothing = {0}, here = loaded(pile->height + i);
    const Wholes bare = loaded(pile->grains + i) == 0;
    const Wholes lacks = more(pile->depth - held, nothing) & bare;
    const Reals whole = reals(held + lacks);
    const Wholes theta_here = here - loaded(pile->height + i + 1);
    const Wholes bend = (loaded(pile->height + i - 1) - here) - theta_here;
    const Reals slope = (reals(theta_here) - pile->curvature * reals(bend)) * pile->steepness;
    Reals phi[N], theta[N], push[N], exposed[N];
    Wholes touching[N], left = nothing + pile->contacts;
    for (int a = 0; a < N; a++)
        phi[a] = (reals(layer[a] * pile->tall[a]) + reals(lacks) * pile->rigid[a]) / whole;
    for (int a = 0; a < N; a++) {
        theta[a] = all(0.0);
        for (int b = 0; b < N; b++) theta[a] += pile->repose[a][b] * phi[b];
        push[a] = positive(slope - theta[a], pile->smoothing);
        touching[a] = fewer(rolling[a], left);
        left -= touching[a];
        exposed[a] = reals(touching[a] * pile->tall[a]) * pile->unit;
        const Reals rate = pile->gamma[a][a] * positive(theta[a] - slope, pile->smoothing);
        put_down(pile, a, i, pile->sharpness * rate * dt, touching[a]);
    }
    const Reals per_thickness = dt / (whole * pile->unit);
    for (int a = 0; a < N; a++) {
        Reals struck = all(0.0);
        for (int b = 0; b < N; b++)
            struck += (pile->mu[b][a] + pile->gamma[b][a] * push[b]) * exposed[b];
        put_down(pile, N + a, i, pile->amplification * struck * per_thickness, layer[a]);
    }
    return 1;
}

/* ---- grains, column by column ---- */

INLINE int64_t bury(Pile *pile, int64_t i, const int N) {
    int64_t count = 0;
    int b = 0;
    for (int a = 0; a < N; a++) count += pile->layer[a][i];
    int64_t left = (int64_t)(((mixed(pile->random += GOLDEN) >> 32) * (uint64_t)count) >> 32);
    for (int a = 0; a < N - 1; a++) {
        left -= pile->layer[a][i];
        b += left >= 0;
    }
    pile->layer[b][i]--;
    pile->stack[i * pile->places + pile->grains[i]++] = (int8_t)b;
    return pile->tall[b];
}

INLINE int64_t lay(Pile *pile, int64_t i, int a, int64_t grains, int64_t held, const int N) {
    for (int64_t k = 0; k < grains; k++) {
        while (held > 0 && held + pile->tall[a] > pile->depth) held -= bury(pile, i, N);
        pile->layer[a][i]++;
        held += pile->tall[a];
    }
    pile->height[i] += grains * pile->tall[a];
    return held;
}

INLINE int64_t held_in(const Pile *pile, int64_t i, const int N) {
    int64_t held = 0;
    for (int a = 0; a < N; a++) held += pile->layer[a][i] * pile->tall[a];
    return held;
}

INLINE int64_t drawn(Pile *pile, int draw, int64_t i, int64_t n) {
    const double none = pile->none[draw][i];
    if (none == NO_DRAW) return 0;
    if (none == UNCOMMON) return uncommon(&pile->random, n, pile->chance[draw][i]);
    const double left = real_of(mixed(pile->random += GOLDEN));
    return left < none ? 0 : inverted(left, none, n, pile->chance[draw][i]);
}

INLINE void move_grains(Pile *pile, int64_t i, const int N) {
    int64_t captured[N], left = pile->contacts;
    for (int a = 0; a < N; a++) {
        const int64_t rolls = pile->rolling[a][i], touching = rolls < left ? rolls : left;
        left -= touching;
        captured[a] = drawn(pile, a, i, touching);
    }
    for (int a = 0; a < N; a++) {
        const int64_t loosened = drawn(pile, N + a, i, pile->layer[a][i]);
        pile->layer[a][i] -= loosened;
        pile->height[i] -= loosened * pile->tall[a];
        pile->rolling[a][i] += loosened - captured[a];
    }
    int64_t held = held_in(pile, i, N);
    for (int a = 0; a < N; a++) held = lay(pile, i, a, captured[a], held, N);
    while (pile->grains[i] && (!held || held + pile->tallest <= pile->depth)) {
        const int b = pile->stack[i * pile->places + --pile->grains[i]];
        pile->layer[b][i]++;
        held += pile->tall[b];
    }
}

/* Whether any of the draws of column i, whose words follow `random`, moves a grain. */
INLINE int moves(const Pile *pile, int64_t i, uint64_t *random, const int N) {
    int moved = 0;
    for (int draw = 0; draw < 2 * N; draw++) {
        const double none = pile->none[draw][i];
        const uint64_t next = *random + GOLDEN;
        moved |= real_of(mixed(next)) >= none;
        *random = none == NO_DRAW ? *random : next;
    }
    return moved;
}

INLINE int64_t exchange(Pile *pile, double dt, int64_t left, const int N) {
    const int64_t wall = pile->columns - 1;
    int64_t exchanges = 0;
    pile->height[-1] = 2 * pile->height[0] - pile->height[1];
    uint8_t rolls[wall / LANES + 1];
    for (int64_t i = 0; i < wall; i += LANES) rolls[i / LANES] = (uint8_t)find_chances(pile, i, dt, N);
    for (int64_t from = 0; from < wall; from += LANES) {
        if (!rolls[from / LANES]) continue;
        const int64_t to = from + LANES < wall ? from + LANES : wall;
        exchanges += to - from;
        for (int64_t i = from; i < to; i++) {
            uint64_t random = pile->random;
            if (moves(pile, i, &random, N))
                move_grains(pile, i, N);
            else
                pile->random = random;
        }
    }
    int64_t held = held_in(pile, wall, N);
    for (int a = 0; a < N; a++) {
        const int64_t captured = pile->rolling[a][wall] / left;
        pile->rolling[a][wall] -= captured;
        held = lay(pile, wall, a, captured, held, N);
    }
    return exchanges;
}

INLINE int64_t substeps_of(const Pile *pile, const Job *job, const int N) {
    double busiest = 0.0;
    for (int64_t i = 0; i < pile->columns; i++) {
        double busy = 0.0;
        int64_t left = pile->contacts;
        for (int a = 0; a < N; a++) {
            const int64_t rolls = pile->rolling[a][i], touching = rolls < left ? rolls : left;
            left -= touching;
            busy += job->fastest[a] * ((double)(touching * pile->tall[a]) * pile->unit);
        }
        busiest = busy > busiest ? busy : busiest;
    }
    const double climb = busiest * (1.0 + 2.0 * job->curvature_length / job->width);
    const double substeps = ceil(climb * job->step / (COURANT * job->width));
    return substeps > 1.0 ? (int64_t)substeps : 1;
}

INLINE void advance(Job *job, Pile *pile, const int N) {
    for (int64_t step = 0; step < job->steps; step++) {
        for (int a = 0; a < N; a++) {
            int64_t *rolling = pile->rolling[a];
            memmove(rolling + 1, rolling, (size_t)(pile->columns - 1) * sizeof *rolling);
            rolling[0] = job->arrivals[step * N + a];
        }
        const int64_t substeps = substeps_of(pile, job, N);
        const double dt = job->step / (double)substeps;
        for (int64_t k = 0; k < substeps; k++) job->exchanges += exchange(pile, dt, substeps - k, N);
    }
}

static Pile taken_in(const Job *job, int64_t *wholes, double *reals) {
    const int64_t columns = job->columns, row = columns + 2 * LANES, N = job->ranks;
    Pile pile = {
        .columns = columns, .places = job->places, .contacts = job->contacts, .depth = job->depth,
        .smoothing = job->smoothing, .curvature = job->curvature_length / job->width,
        .steepness = job->unit / job->width, .sharpness = job->sharpness,
        .amplification = job->amplification, .unit = job->unit,
        .height = wholes + LANES, .grains = wholes + row, .stack = job->stack,
        .random = *job->random,
    };
    memcpy(pile.height, job->height, (size_t)columns * 8);
    memcpy(pile.grains, job->grains, (size_t)columns * 8);
    for (int a = 0; a < N; a++) {
        pile.rolling[a] = wholes + (2 + a) * row;
        pile.layer[a] = wholes + (2 + N + a) * row;
        memcpy(pile.rolling[a], job->rolling + a * columns, (size_t)columns * 8);
        memcpy(pile.layer[a], job->layer + a * columns, (size_t)columns * 8);
        pile.tall[a] = job->grain_height[a];
        pile.tallest = pile.tall[a] > pile.tallest ? pile.tall[a] : pile.tallest;
        pile.rigid[a] = job->rigid_fraction[a];
        for (int b = 0; b < N; b++) {
            pile.repose[a][b] = job->repose_slope[a * N + b];
            pile.gamma[a][b] = job->collision_rate[a * N + b];
            pile.mu[a][b] = job->cross_amplification[a * N + b];
        }
    }
    for (int draw = 0; draw < 2 * N; draw++) {
        pile.chance[draw] = reals + 2 * draw * row;
        pile.none[draw] = reals + (2 * draw + 1) * row;
    }
    return pile;
}

static void give_back(const Pile *pile, Job *job) {
    const size_t row = (size_t)pile->columns;
    memcpy(job->height, pile->height, row * 8);
    memcpy(job->grains, pile->grains, row * 8);
    for (int64_t a = 0; a < job->ranks; a++) {
        memcpy(job->rolling + a * pile->columns, pile->rolling[a], row * 8);
        memcpy(job->layer + a * pile->columns, pile->layer[a], row * 8);
    }
    *job->random = pile->random;
}

/* Take the steps of `job`; 0, or 1 where there is no memory, or are more ranks, for it. Stacks must
 * have places for all that comes to rest. */
int advance_rates(Job *job) {
    if (job->ranks > MOST_RANKS) return 1;
    const size_t row = (size_t)job->columns + 2 * LANES, ranks = (size_t)job->ranks;
    int64_t *wholes = calloc((2 + 2 * ranks) * row, sizeof *wholes);
    double *reals = calloc(4 * ranks * row, sizeof *reals);
    if (!wholes || !reals) return 1;
    Pile pile = taken_in(job, wholes, reals);
    switch (job->ranks) {
        case 1: advance(job, &pile, 1); break;
        case 2: advance(job, &pile, 2); break;
        case 3: advance(job, &pile, 3); break;
        default: advance(job, &pile, 4);
    }
    give_back(&pile, job);
    free(wholes);
    free(reals);
    return 0;
}
