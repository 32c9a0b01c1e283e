/* The rate rule in a silo as fast as C goes: the yardstick of ca_model/rates/kernel.py. The same
 * words of SplitMix64 in the same order and the same doubles (no contraction to FMA but where it is
 * written, as division by a constant, whose rounding it keeps), so the very same grains.
 *
 * All columns meet the heights with which a sub-step begins, so what does not hang on the random
 * words is found first, eight columns in the lanes of a register: chances, and how likely none of so
 * many grains is captured or set rolling, (1 - p)^n. What is left is a word for each draw and a
 * comparison, the eight draws of two columns in the lanes of a register; only where a grain moves is
 * there more to do, and there the four draws of a column are inverted at once.
 *
 * Two species; arrays are (rank, column) as in the kernel, the smallest rank is 0.
 */
#include <immintrin.h>
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#define COURANT 0.25
#define CERTAIN 40.0
#define MOST_AT_ONCE 16.0
#define N 2         /* ranks */
#define DRAWS (2 * N) /* of a column: capture by rank, then setting rolling */
#define LANES 8
#define NO_DRAW 2.0     /* as a probability that nothing moves: no word is drawn */
#define UNCOMMON (-1.0) /* certain, likelier than not, or of so many that several are drawn */
#define GOLDEN 0x9E3779B97F4A7C15u
#define INLINE static inline __attribute__((always_inline))
#define LIKELY(x) __builtin_expect(!!(x), 1)

typedef double Reals __attribute__((vector_size(64)));
typedef int64_t Wholes __attribute__((vector_size(64)));
typedef double FourReals __attribute__((vector_size(32)));
typedef int64_t FourWholes __attribute__((vector_size(32)));

typedef struct {
    int64_t columns, places, steps;
    int64_t *height;  /* (1 + column + 1,) */
    int64_t *rolling; /* (rank, 1 + column + 1) */
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
    int64_t columns, places, contacts, depth, tallest, tall[N];
    double repose[N][N], gamma[N][N];
    double mu[N][N], rigid[N];
    double smoothing, curvature, steepness, sharpness, amplification, unit;
    int64_t *height, *rolling[N], *layer[N], *grains;
    double *chance, *none; /* (column, draw) */
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

/* What the states of the next eight words are ahead of this one's. */
INLINE __m512i words_ahead(void) {
    const __m512i numbers = _mm512_setr_epi64(1, 2, 3, 4, 5, 6, 7, 8);
    return _mm512_mullo_epi64(numbers, _mm512_set1_epi64((int64_t)GOLDEN));
}

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

INLINE Reals chance_within(Reals expected) {
    const Reals y = expected * 0.0625;
    Reals grown = 1.0 + y * (1.0 + y * (0.5 + y * (1.0 / 6 + y * (1.0 / 24 +
                  y * (1.0 / 120 + y * (1.0 / 720))))));
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

typedef struct {
    Reals chance, none;
} Draw;

/* How likely an event is that is `expected` so often, and that none of n has it. */
INLINE Draw draw_of(Reals expected, Wholes n) {
    const Wholes drawn = (expected > 0.0) & (n > 0);
    Draw draw = {all(0.0), all(NO_DRAW)};
    if (some(drawn)) {
        draw.chance = chance_within(expected);
        const Wholes common = (draw.chance <= 0.5) & (reals(n) * draw.chance <= MOST_AT_ONCE);
        const int64_t largest = _mm512_reduce_max_epi64((__m512i)n);
        Reals base = 1.0 - draw.chance, power = all(1.0);
        for (int64_t bit = 1; bit <= largest; bit <<= 1, base *= base)
            power = choose((n & bit) != 0, power * base, power);
        const Reals none = choose(common, power, all(UNCOMMON));
        draw.none = choose(drawn & (draw.chance > 0.0), none, draw.none);
    }
    return draw;
}

/* Four registers, a draw each, as eight columns of four draws. */
INLINE void put_down(double *to, Reals a, Reals b, Reals c, Reals d) {
    const Wholes low = {0, 8, 1, 9, 2, 10, 3, 11}, high = {4, 12, 5, 13, 6, 14, 7, 15};
    const Wholes left = {0, 1, 8, 9, 2, 3, 10, 11}, right = {4, 5, 12, 13, 6, 7, 14, 15};
    const Reals ab = __builtin_shuffle(a, b, low), cd = __builtin_shuffle(c, d, low);
    const Reals ab_ = __builtin_shuffle(a, b, high), cd_ = __builtin_shuffle(c, d, high);
    store(to, __builtin_shuffle(ab, cd, left));
    store(to + LANES, __builtin_shuffle(ab, cd, right));
    store(to + 2 * LANES, __builtin_shuffle(ab_, cd_, left));
    store(to + 3 * LANES, __builtin_shuffle(ab_, cd_, right));
}

/* Eight columns from i on; whether anything rolls there. */
INLINE int find_chances(Pile *pile, int64_t i, double dt) {
    Wholes rolling[N], layer[N], rolls = (Wholes){0}, held = rolls;
    for (int a = 0; a < N; a++) {
        rolling[a] = loaded(pile->rolling[a] + i);
        rolls |= rolling[a];
    }
    if (!some(rolls != 0)) {
        const Reals never = all(NO_DRAW);
        put_down(pile->none + DRAWS * i, never, never, never, never);
        return 0;
    }
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
    Draw draw[DRAWS];
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
        draw[a] = draw_of(pile->sharpness * rate * dt, touching[a]);
    }
    const Reals per_thickness = dt / (whole * pile->unit);
    for (int a = 0; a < N; a++) {
        Reals struck = all(0.0);
        for (int b = 0; b < N; b++)
            struck += (pile->mu[b][a] + pile->gamma[b][a] * push[b]) * exposed[b];
        draw[N + a] = draw_of(pile->amplification * struck * per_thickness, layer[a]);
    }
    put_down(pile->none + DRAWS * i, draw[0].none, draw[1].none, draw[2].none, draw[3].none);
    put_down(pile->chance + DRAWS * i, draw[0].chance, draw[1].chance, draw[2].chance,
             draw[3].chance);
    return 1;
}

/* ---- grains, column by column ---- */

INLINE int64_t bury(Pile *pile, int64_t i) {
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

/* Lay the captured grains n = (a,) in any order; the last of one species draw no word. */
INLINE int64_t lay(Pile *pile, int64_t i, int64_t *n, int64_t held) {
    int64_t left = 0;
    for (int a = 0; a < N; a++) {
        left += n[a];
        pile->height[i] += n[a] * pile->tall[a];
    }
    for (; left > 0; left--) {
        int a = -1;
        for (int b = 0; b < N; b++) a = n[b] == left ? b : a;
        if (a < 0) {
            int64_t k = (int64_t)(((mixed(pile->random += GOLDEN) >> 32) * (uint64_t)left) >> 32);
            a = 0;
            for (int b = 0; b < N - 1; b++) {
                k -= n[b];
                a += k >= 0;
            }
        }
        n[a]--;
        while (held > 0 && held + pile->tall[a] > pile->depth) held -= bury(pile, i);
        pile->layer[a][i]++;
        held += pile->tall[a];
    }
    return held;
}

INLINE int64_t held_in(const Pile *pile, int64_t i) {
    int64_t held = 0;
    for (int a = 0; a < N; a++) held += pile->layer[a][i] * pile->tall[a];
    return held;
}

/* How many of n = (draw,) in each draw of column i, in place. */
INLINE void draw_all(Pile *pile, int64_t i, int64_t *n) {
    const __m256d none = _mm256_loadu_pd(pile->none + DRAWS * i);
    const double *chance = pile->chance + DRAWS * i;
    if (_mm256_movemask_pd(none)) { /* some are UNCOMMON, the only negative ones */
        for (int draw = 0; draw < DRAWS; draw++) {
            const double weight = pile->none[DRAWS * i + draw];
            if (weight == NO_DRAW)
                n[draw] = 0;
            else if (weight == UNCOMMON)
                n[draw] = uncommon(&pile->random, n[draw], chance[draw]);
            else
                n[draw] = inverted(real_of(mixed(pile->random += GOLDEN)), weight, n[draw],
                                   chance[draw]);
        }
        return;
    }
    const __mmask8 drawn = _mm256_cmp_pd_mask(none, _mm256_set1_pd(1.0), _CMP_LE_OQ);
    const __m256i ahead = _mm256_maskz_expand_epi64(drawn, _mm512_castsi512_si256(words_ahead()));
    FourWholes bits = (FourWholes)ahead + (int64_t)pile->random;
    FourReals left, weight = (FourReals)none;
    for (int draw = 0; draw < DRAWS; draw++) left[draw] = real_of(mixed((uint64_t)bits[draw]));
    const FourReals p = (FourReals)_mm256_loadu_pd(chance), odds = p / (1.0 - p);
    const FourReals most = (FourReals)_mm256_cvtepi64_pd(_mm256_loadu_si256((void *)n));
    FourReals k = {0.0};
    for (;;) {
        __mmask8 on = _mm256_mask_cmp_pd_mask(drawn, (__m256d)left, (__m256d)weight, _CMP_GE_OQ);
        on = _mm256_mask_cmp_pd_mask(on, (__m256d)k, (__m256d)most, _CMP_LT_OQ);
        if (!on) break;
        left = (FourReals)_mm256_mask_sub_pd((__m256d)left, on, (__m256d)left, (__m256d)weight);
        k = (FourReals)_mm256_mask_add_pd((__m256d)k, on, (__m256d)k, _mm256_set1_pd(1.0));
        const FourReals factor = odds * (most - k + 1.0) / k;
        weight = (FourReals)_mm256_mask_mul_pd((__m256d)weight, on, (__m256d)weight, (__m256d)factor);
    }
    _mm256_storeu_si256((void *)n, _mm256_cvtpd_epi64((__m256d)k));
    pile->random += GOLDEN * (uint64_t)__builtin_popcount(drawn);
}

INLINE void move_grains(Pile *pile, int64_t i) {
    int64_t n[DRAWS], left = pile->contacts;
    for (int a = 0; a < N; a++) {
        const int64_t rolls = pile->rolling[a][i];
        n[a] = rolls < left ? rolls : left;
        left -= n[a];
        n[N + a] = pile->layer[a][i];
    }
    draw_all(pile, i, n);
    for (int a = 0; a < N; a++) {
        const int64_t loosened = n[N + a];
        pile->layer[a][i] -= loosened;
        pile->height[i] -= loosened * pile->tall[a];
        pile->rolling[a][i] += loosened - n[a];
    }
    int64_t held = held_in(pile, i);
    held = lay(pile, i, n, held);
    while (pile->grains[i] && (!held || held + pile->tallest <= pile->depth)) {
        const int b = pile->stack[i * pile->places + --pile->grains[i]];
        pile->layer[b][i]++;
        held += pile->tall[b];
    }
}

/* Move grains in columns from i on, up to the next one in which any moves; the column after it. */
INLINE int64_t move_in_turn(Pile *pile, int64_t i) {
    const Reals none = (Reals)_mm512_loadu_pd(pile->none + DRAWS * i);
    const __mmask8 drawn = _mm512_cmp_pd_mask((__m512d)none, _mm512_set1_pd(1.0), _CMP_LE_OQ);
    __m512i bits = _mm512_maskz_expand_epi64(drawn, words_ahead());
    bits = _mm512_add_epi64(bits, _mm512_set1_epi64((int64_t)pile->random));
    bits = _mm512_xor_si512(bits, _mm512_srli_epi64(bits, 30));
    bits = _mm512_mullo_epi64(bits, _mm512_set1_epi64((int64_t)0xBF58476D1CE4E5B9u));
    bits = _mm512_xor_si512(bits, _mm512_srli_epi64(bits, 27));
    bits = _mm512_mullo_epi64(bits, _mm512_set1_epi64((int64_t)0x94D049BB133111EBu));
    bits = _mm512_xor_si512(bits, _mm512_srli_epi64(bits, 31));
    const Reals words = reals((Wholes)_mm512_srli_epi64(bits, 11)) * 0x1p-53;
    const __mmask8 moves = _mm512_mask_cmp_pd_mask(drawn, (__m512d)words, (__m512d)none, _CMP_GE_OQ);
    if (!moves) {
        pile->random += GOLDEN * (uint64_t)__builtin_popcount(drawn);
        return i + 2;
    }
    if (moves & 0xF) {
        move_grains(pile, i);
        return i + 1;
    }
    pile->random += GOLDEN * (uint64_t)__builtin_popcount(drawn & 0xF);
    move_grains(pile, i + 1);
    return i + 2;
}

INLINE int64_t exchange(Pile *pile, double dt, int64_t left) {
    const int64_t wall = pile->columns - 1;
    int64_t exchanges = 0, end = 0;
    pile->height[-1] = 2 * pile->height[0] - pile->height[1];
    for (int64_t i = 0; i < wall; i += LANES) {
        if (find_chances(pile, i, dt)) {
            exchanges += LANES;
            end = i + LANES;
        }
    }
    if (end > wall) end = wall;
    for (int draw = 0; draw < DRAWS; draw++) pile->none[DRAWS * end + draw] = NO_DRAW;
    for (int64_t i = 0; i < end;) i = move_in_turn(pile, i);
    int64_t held = held_in(pile, wall);
    for (int a = 0; a < N; a++) {
        int64_t captured[N] = {0};
        captured[a] = pile->rolling[a][wall] / left;
        pile->rolling[a][wall] -= captured[a];
        held = lay(pile, wall, captured, held);
    }
    return exchanges;
}

INLINE int64_t substeps_of(const Pile *pile, const Job *job) {
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

INLINE void advance(Job *job, Pile *pile) {
    for (int64_t step = 0; step < job->steps; step++) {
        for (int a = 0; a < N; a++) {
            int64_t *rolling = pile->rolling[a];
            memmove(rolling + 1, rolling, (size_t)(pile->columns - 1) * sizeof *rolling);
            rolling[0] = job->arrivals[step * N + a];
        }
        const int64_t substeps = substeps_of(pile, job);
        const double dt = job->step / (double)substeps;
        for (int64_t k = 0; k < substeps; k++) job->exchanges += exchange(pile, dt, substeps - k);
    }
}

static Pile taken_in(const Job *job, int64_t *wholes, double *reals) {
    const int64_t columns = job->columns, row = columns + 2 * LANES;
    Pile pile = {
        .columns = columns, .places = job->places, .contacts = job->contacts, .depth = job->depth,
        .smoothing = job->smoothing, .curvature = job->curvature_length / job->width,
        .steepness = job->unit / job->width, .sharpness = job->sharpness,
        .amplification = job->amplification, .unit = job->unit,
        .height = wholes + LANES, .grains = wholes + row, .stack = job->stack,
        .random = *job->random,
    };
    memcpy(pile.height, job->height + 1, (size_t)columns * 8);
    memcpy(pile.grains, job->grains, (size_t)columns * 8);
    for (int a = 0; a < N; a++) {
        pile.rolling[a] = wholes + (2 + a) * row;
        pile.layer[a] = wholes + (2 + N + a) * row;
        memcpy(pile.rolling[a], job->rolling + a * (columns + 2) + 1, (size_t)columns * 8);
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
    pile.chance = reals;
    pile.none = reals + DRAWS * row;
    return pile;
}

static void give_back(const Pile *pile, Job *job) {
    const size_t row = (size_t)pile->columns;
    memcpy(job->height + 1, pile->height, row * 8);
    memcpy(job->grains, pile->grains, row * 8);
    for (int a = 0; a < N; a++) {
        memcpy(job->rolling + a * (pile->columns + 2) + 1, pile->rolling[a], row * 8);
        memcpy(job->layer + a * pile->columns, pile->layer[a], row * 8);
    }
    *job->random = pile->random;
}

/* Take the steps of `job`; 0, or 1 where there is no memory for it. Stacks must have places for all
 * that comes to rest. */
int advance_rates(Job *job) {
    const size_t row = (size_t)job->columns + 2 * LANES;
    int64_t *wholes = calloc((2 + 2 * N) * row, sizeof *wholes);
    double *reals = calloc(2 * DRAWS * row, sizeof *reals);
    if (!wholes || !reals) return 1;
    Pile pile = taken_in(job, wholes, reals);
    advance(job, &pile);
    give_back(&pile, job);
    free(wholes);
    free(reals);
    return 0;
}
