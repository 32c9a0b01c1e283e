/* The lattice rule of ca_model/reference.py, grain for grain, as fast as C goes.

   A packet is what rolls together: the grains fed in step k are in column t - k in step t. Packets
   are followed one after the other, each on its whole way downhill, rather than all at once step by
   step. That is the same pour: in column i packet k meets all captures of packets before it in i,
   and in i + 1 those of packets up to k - 2; so only what packet k - 1 added to i + 1 is held back
   until packet k has passed. A step then costs its captures, however long the pile is, because

   1. columns that would capture a species are bits of a set, one set a species, and sets of the
      words of that set which are not empty stand above it (64 x 64 x 64 x 64 columns): the next
      column that captures a packet is found by a few counts of trailing zeros;
   2. captures move about slowly (a kink climbs the pile). A window of 64 columns about them stays
      in registers: slopes, thresholds of the surface and its species are bytes of AVX-512
      registers, one comparison makes the bit sets, and no branch depends on where a grain stops
      (a window costs some 50 ns to open and close, and lasts for 60 packets and more);
   3. grains at rest are appended to a log, which is split into stacks afterwards.

   Slopes beyond +-40, starts and ends of packets inside the window, and whatever else does not fit
   take the way of 1 alone. */

#include <immintrin.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#define INLINE static inline __attribute__((always_inline))
#define LIKELY(x) __builtin_expect(!!(x), 1)
#define UNROLLED _Pragma("GCC unroll 8")

enum { MOST_SPECIES = 8, LEVELS = 4, STEEPEST = 40, AHEAD = 40, WORTH_IT = 8, LONGEST_WAIT = 64 };
enum Contacts { ONE, SOME, ALL };

typedef uint64_t Bits;
typedef __m512i Bytes;

typedef struct {
    int64_t columns, species, contacts, steps;
    const int64_t *grain_height, *threshold, *smallest_first;
    int64_t *height;  /* (column,) */
    int64_t *rolling; /* (column, species) */
    int64_t *top;     /* (column,) the species on top of the stack */
    const int64_t *arrivals; /* (step, species) */
    uint32_t *log;    /* column << 3 | species, in the order of capture; room for all that rolls */
    int64_t logged;
} Job;

/* From here on a species is its place among the smallest first. */
typedef struct {
    int32_t columns, words;
    int64_t contacts;
    int32_t species[MOST_SPECIES]; /* its number in the job */
    int32_t height[MOST_SPECIES], threshold[MOST_SPECIES][MOST_SPECIES]; /* [surface][grain] */
    int32_t *state;     /* (column,) slope << 3 | top; the last one's slope is its height */
    Bits *set[LEVELS];  /* (word, species) columns that capture; above it words not empty */
    uint32_t *log;
    int32_t height_of[MOST_SPECIES]; /* by number in the job */
    Bytes of_surface[MOST_SPECIES];  /* thresholds of a grain, a byte a surface */
    int species_count;
    int fits; /* whether heights and thresholds fit into bytes */
} Pile;

typedef struct {
    int64_t grains[MOST_SPECIES];
    int32_t column, stop; /* it goes on from `column`, and stays below `stop` */
    int meets_wall;
} Packet;

/* ---- bit sets; the last column is in all of them, so a next one is always found ---- */

INLINE int32_t first_of(Bits word) { return (int32_t)_tzcnt_u64(word); }

INLINE int32_t next_column(const Pile *pile, int N, int a, int32_t i) {
    int32_t level = 0;
    Bits word = pile->set[0][(i >> 6) * N + a] >> (i & 63);
    while (!word) {
        i = (i >> 6) + 1;
        level++;
        word = pile->set[level][(i >> 6) * N + a] >> (i & 63);
    }
    i += first_of(word);
    while (level--) i = i << 6 | first_of(pile->set[level][i * N + a]);
    return i;
}

INLINE void put_word(Pile *pile, int N, int a, int32_t w, Bits word) {
    Bits before = pile->set[0][w * N + a];
    pile->set[0][w * N + a] = word;
    for (int level = 1; level < LEVELS && !before != !word; level++) {
        Bits bit = (Bits)1 << (w & 63);
        w >>= 6;
        before = pile->set[level][w * N + a];
        word = word ? before | bit : before & ~bit;
        pile->set[level][w * N + a] = word;
    }
}

INLINE void put_bit(Pile *pile, int N, int a, int32_t i, Bits on) {
    Bits word = pile->set[0][(i >> 6) * N + a];
    put_word(pile, N, a, i >> 6, (word & ~((Bits)1 << (i & 63))) | on << (i & 63));
}

INLINE void put_window(Pile *pile, int N, int a, int32_t base, Bits in, Bits bits) {
    int32_t w = base >> 6, shift = base & 63;
    put_word(pile, N, a, w, (pile->set[0][w * N + a] & ~(in << shift)) | bits << shift);
    if (shift && w + 1 < pile->words) {
        Bits rest = pile->set[0][(w + 1) * N + a];
        put_word(pile, N, a, w + 1, (rest & ~(in >> (64 - shift))) | bits >> (64 - shift));
    }
}

/* ---- one column ---- */

INLINE void put_state(Pile *pile, int N, int32_t i, int32_t state) {
    pile->state[i] = state;
    const int32_t *threshold = pile->threshold[state & 7];
    for (int a = 0; a < N; a++) put_bit(pile, N, a, i, (state >> 3) < threshold[a]);
}

INLINE int32_t topped(const Pile *pile, int32_t state, int a) {
    return (state & ~7) + 8 * pile->height[a] + a;
}

INLINE void note(Pile *pile, int32_t i, int a) {
    *pile->log++ = (uint32_t)i << 3 | (uint32_t)pile->species[a];
}

/* What the packet before added to the columns that it met, now felt uphill of them. */
INLINE void lower_uphill(Pile *pile, int N, const uint32_t *from, const uint32_t *to) {
    for (; from < to; from++) {
        int32_t i = (int32_t)(*from >> 3) - 1;
        if (i >= 0) put_state(pile, N, i, pile->state[i] - 8 * pile->height_of[*from & 7]);
    }
}

/* ---- 1: by bit sets alone ---- */

static __attribute__((noinline)) void follow(Pile *pile, int N, Packet *packet) {
    int64_t touches = pile->contacts;
    int32_t i = packet->column;
    for (int a = 0; a < N; a++) {
        while (packet->grains[a] > 0) {
            int32_t next = next_column(pile, N, a, i);
            if (next >= packet->stop) {
                if (!packet->meets_wall) return;
                goto wall;
            }
            if (next != i) touches = pile->contacts;
            i = next;
            put_state(pile, N, i, topped(pile, pile->state[i], a));
            note(pile, i, a);
            packet->grains[a]--;
            if (--touches == 0) {
                i++;
                touches = pile->contacts;
            }
        }
    }
    return;
wall:
    i = pile->columns - 1;
    for (int a = 0; a < N; a++) {
        for (; packet->grains[a] > 0; packet->grains[a]--) {
            pile->state[i] = topped(pile, pile->state[i], a);
            note(pile, i, a);
        }
    }
}

/* ---- 2: by a window in registers ---- */

typedef struct {
    int32_t base, end; /* the first column, and the one after the last; closed: end = 0 */
    Bits in;           /* its columns */
    int all_first;     /* bit a: no column before the window captures a */
    Bytes slope, top, held_back; /* a byte a column */
} Window;

/* The window with the first column that captures the smallest species; it stays closed where
   the packet starts or ends inside, or slopes or what the packet before added do not fit. */
static Window opened(const Pile *pile, int N, const Packet *packet, const uint32_t *before) {
    Window w = {0};
    int32_t wall = pile->columns - 1, first = next_column(pile, N, 0, 0);
    w.base = first < AHEAD ? 0 : first - AHEAD;
    int32_t end = w.base + 64 < wall ? w.base + 64 : wall;
    if (packet->column > w.base || packet->stop < end) return w;
    w.in = end - w.base < 64 ? ((Bits)1 << (end - w.base)) - 1 : ~(Bits)0;
    int8_t held_back[64] = {0};
    for (; before < pile->log; before++) {
        int32_t i = (int32_t)(*before >> 3) - 1;
        if (i < 0) continue;
        if (i < w.base || i >= end) return w;
        held_back[i - w.base] += (int8_t)pile->height_of[*before & 7];
        if (held_back[i - w.base] > STEEPEST) return w;
    }
    __m128i slope[4], top[4];
    __mmask16 steep = 0;
    for (int q = 0; q < 4; q++) {
        __mmask16 in = (__mmask16)(w.in >> 16 * q);
        Bytes state = _mm512_maskz_loadu_epi32(in, pile->state + w.base + 16 * q);
        Bytes wide = _mm512_srai_epi32(state, 3);
        steep |= _mm512_cmpgt_epi32_mask(_mm512_abs_epi32(wide), _mm512_set1_epi32(STEEPEST));
        slope[q] = _mm512_cvtepi32_epi8(wide);
        top[q] = _mm512_cvtepi32_epi8(_mm512_and_si512(state, _mm512_set1_epi32(7)));
    }
    if (steep) return w;
    memcpy(&w.slope, slope, 64);
    memcpy(&w.top, top, 64);
    memcpy(&w.held_back, held_back, 64);
    for (int a = 0; a < N; a++) w.all_first |= (next_column(pile, N, a, 0) >= w.base) << a;
    w.end = end;
    return w;
}

static void close_window(Pile *pile, int N, Window *w) {
    __m128i slope[4], top[4];
    memcpy(slope, &w->slope, 64);
    memcpy(top, &w->top, 64);
    for (int q = 0; q < 4; q++) {
        Bytes wide = _mm512_slli_epi32(_mm512_cvtepi8_epi32(slope[q]), 3);
        _mm512_mask_storeu_epi32(pile->state + w->base + 16 * q, (__mmask16)(w->in >> 16 * q),
                                 _mm512_or_si512(wide, _mm512_cvtepi8_epi32(top[q])));
    }
    for (int a = 0; a < N; a++) {
        Bytes threshold = _mm512_permutexvar_epi8(w->top, pile->of_surface[a]);
        Bits set = _mm512_mask_cmplt_epi8_mask(w->in, w->slope, threshold);
        put_window(pile, N, a, w->base, w->in, set);
    }
    w->end = 0;
}

typedef struct {
    enum { ALL_PASSED, NOT_BEGUN, REMAINS, OUTGROWN } why; /* it ended */
    int64_t passed;         /* packets that were captured as a whole */
    uint32_t *before, *own; /* where the logs of the last one passed and of the next one begin */
} Passage;

/* Up to `count` packets, whose grains are `stride` apart, pass through the window. The one that is
   not captured as a whole (REMAINS) has `rest`, and goes on below the window. Where columns are found
   they are taken to capture once a packet; one that would do so `twice` has the packet redone. */
INLINE Passage pass(Pile *pile, Window *window, const int64_t *row, int64_t stride, int64_t count,
                    int64_t *rest, uint32_t *before, const int N,
                    const enum Contacts contacts) {
    Bytes height[N], number[N], become[N][N], again_below[N][N], threshold[N];
    Bits set[N], again[N][N];
    int64_t at[N];
    const int species = pile->species_count;
    uint32_t noted[N];
    const Bits in = window->in, edge = window->base > 0;
    const Bytes least = _mm512_set1_epi8(-STEEPEST);
    Bytes slope = window->slope, top = window->top, held_back = window->held_back;
    UNROLLED for (int a = 0; a < N; a++) {
        at[a] = pile->species[a];
        noted[a] = (uint32_t)window->base << 3 | (uint32_t)pile->species[a];
        height[a] = _mm512_set1_epi8((char)pile->height[a]);
        number[a] = _mm512_set1_epi8((char)a);
        UNROLLED for (int b = 0; b < N; b++) {
            become[a][b] = _mm512_set1_epi8((char)pile->threshold[a][b]);
            again_below[a][b] = _mm512_set1_epi8((char)(pile->threshold[a][b] - pile->height[a]));
        }
        threshold[a] = _mm512_permutexvar_epi8(top, pile->of_surface[a]);
        set[a] = _mm512_mask_cmplt_epi8_mask(in, slope, threshold[a]);
    }
#define FIND_SETS                                                                 \
    UNROLLED for (int b = 0; b < N; b++)                                          \
        set[b] = _mm512_mask_cmplt_epi8_mask(in, slope, threshold[b]);
#define LAY(a, columns)                                                           \
    slope = _mm512_mask_add_epi8(slope, columns, slope, height[a]);               \
    top = _mm512_mask_mov_epi8(top, columns, number[a]);                          \
    held = _mm512_mask_add_epi8(held, (columns) >> 1, held, height[a]);           \
    UNROLLED for (int b = 0; b < N; b++)                                          \
        threshold[b] = _mm512_mask_mov_epi8(threshold[b], columns, become[a][b]);

#define FIND_AGAIN                                                                \
    if (contacts != ONE) {                                                        \
        UNROLLED for (int a = 0; a < N; a++) UNROLLED for (int b = a; b < N; b++) \
            again[a][b] = _mm512_mask_cmplt_epi8_mask(in, slope, again_below[a][b]); \
    }
    FIND_AGAIN
    uint32_t *log = pile->log;
    Passage passage = {ALL_PASSED, 0, before, log};
    for (; passage.passed < count; passage.passed++, row += stride) {
        int64_t grains[N];
        UNROLLED for (int a = 0; a < N; a++) {
            grains[a] = N < MOST_SPECIES || a < species ? row[at[a]] : 0;
        }
        int smallest = 0;
        UNROLLED for (int a = N - 1; a >= 0; a--) smallest = grains[a] ? a : smallest;
        if (!LIKELY(window->all_first >> smallest & 1)) {
            passage.why = NOT_BEGUN;
            break;
        }
        passage.own = log;
        Bits taken[N], pending[N], captured = 0, from = ~(Bits)0, twice = 0;
        int64_t missed = 0;
        UNROLLED for (int a = 0; a < N; a++) pending[a] = 0;
        UNROLLED for (int a = 0; a < N; a++) {
            Bits open = set[a] & from, bit = 0;
            int64_t left = grains[a];
            taken[a] = 0;
            if (contacts != ONE && left) twice |= pending[a];
            for (; left > 0 && LIKELY(open); left--) {
                bit = open & -open;
                open ^= bit;
                taken[a] |= bit;
                if (contacts != ONE && left > 1) twice |= bit & again[a][a];
                *log++ = noted[a] + 8 * (uint32_t)first_of(bit);
            }
            if (bit) {
                from = -(bit << 1);
                UNROLLED for (int b = a + 1; b < N; b++) pending[b] = bit & again[a][b];
            }
            if (left) from = 0;
            missed |= left;
            rest[a] = left;
            captured |= taken[a];
        }
        Bytes held = _mm512_setzero_si512();
        slope = _mm512_sub_epi8(slope, held_back);
        if (contacts == ONE || LIKELY(!twice)) {
            UNROLLED for (int a = 0; a < N; a++) {
                LAY(a, taken[a])
            }
        } else { /* a column captures several grains of the packet: one by one */
            int64_t touches = pile->contacts;
            Bits last = 0;
            slope = _mm512_add_epi8(slope, held_back);
            log = passage.own;
            from = ~(Bits)0;
            missed = captured = 0;
            UNROLLED for (int a = 0; a < N; a++) {
                int64_t left = grains[a];
                for (; left > 0 && (set[a] & from); left--) {
                    Bits open = set[a] & from, bit = open & -open;
                    if (bit != last) touches = pile->contacts;
                    last = bit;
                    captured |= bit;
                    LAY(a, bit)
                    FIND_SETS
                    *log++ = noted[a] + 8 * (uint32_t)first_of(bit);
                    from = --touches ? -bit : -(bit << 1);
                }
                if (left) from = 0;
                missed |= left;
                rest[a] = left;
            }
            slope = _mm512_sub_epi8(slope, held_back);
        }
        if (!LIKELY(!missed)) {
            slope = _mm512_add_epi8(slope, held_back);
            passage.why = REMAINS;
            break;
        }
        held_back = held;
        before = passage.own;
        FIND_SETS
        FIND_AGAIN
        if (!LIKELY(!(captured & edge)) ||
            !LIKELY(!_mm512_mask_cmplt_epi8_mask(in, slope, least))) {
            passage.passed++;
            passage.why = OUTGROWN;
            break;
        }
    }
    window->slope = slope;
    window->top = top;
    window->held_back = held_back;
    passage.before = before;
    pile->log = log;
    return passage;
}

/* ---- packets, the lowest first ---- */

INLINE Packet packet_of(const Pile *pile, const Job *job, int64_t k) {
    const int64_t *row = k < 0 ? job->rolling - (k + 1) * job->species
                               : job->arrivals + k * job->species;
    Packet packet = {.column = k < 0 ? (int32_t)-k : 0};
    packet.meets_wall = job->steps - k >= pile->columns;
    packet.stop = packet.meets_wall ? pile->columns - 1 : (int32_t)(job->steps - k);
    for (int a = 0; a < job->species; a++) packet.grains[a] = row[pile->species[a]];
    return packet;
}

/* What is left of packet k rolls on, unless it has met the wall by now. */
INLINE void put_rolling(const Pile *pile, Job *job, int64_t k, const int64_t *grains) {
    if (job->steps - k > pile->columns) return;
    int64_t *rolling = job->rolling + (job->steps - 1 - k) * job->species;
    for (int a = 0; a < job->species; a++) rolling[pile->species[a]] = grains[a];
}

INLINE void pour(Pile *pile, Job *job, const int N, const enum Contacts contacts) {
    const int64_t steps = job->steps, species = job->species, none[MOST_SPECIES] = {0};
    uint32_t *before = pile->log;
    Window w = {0};
    int64_t retry = -pile->columns, wait = 1; /* no window is opened again and again in vain */
    for (int64_t k = 1 - pile->columns; k < steps;) {
        Packet packet = packet_of(pile, job, k);
        if (pile->fits && !w.end && k >= retry) {
            w = opened(pile, N, &packet, before);
            if (!w.end) retry = k + (wait = wait < LONGEST_WAIT ? 2 * wait : wait);
        }
        uint32_t *own = pile->log;
        if (w.end) {
            int64_t last = steps - w.end, to = k < 0 && last >= 0 ? -1 : last;
            const int64_t *row = k < 0 ? job->rolling - (k + 1) * species
                                       : job->arrivals + k * species;
            Passage passage = pass(pile, &w, row, k < 0 ? -species : species, to - k + 1,
                                   packet.grains, before, N, contacts);
            int64_t passed_to = k + passage.passed;
            wait = passage.passed > WORTH_IT ? 1 : wait < LONGEST_WAIT ? 2 * wait : wait;
            retry = passed_to + wait;
            if (k < steps - pile->columns) k = steps - pile->columns;
            while (k < passed_to) put_rolling(pile, job, k++, none);
            k = passed_to;
            before = passage.before;
            int32_t end = w.end;
            if (passage.why != ALL_PASSED || to == last) close_window(pile, N, &w);
            if (passage.why == ALL_PASSED || passage.why == OUTGROWN) continue;
            Packet next = packet_of(pile, job, k);
            if (passage.why == REMAINS) {
                own = passage.own;
                next.column = end;
                memcpy(next.grains, packet.grains, sizeof next.grains);
            } else {
                own = pile->log;
            }
            packet = next;
        }
        follow(pile, N, &packet);
        lower_uphill(pile, N, before, own);
        put_rolling(pile, job, k++, packet.grains);
        before = own;
    }
    if (w.end) close_window(pile, N, &w);
    lower_uphill(pile, N, before, pile->log);
}

/* ---- the job ---- */

static void take_in(Pile *pile, const Job *job, int N) {
    const int32_t wall = (int32_t)job->columns - 1;
    int32_t place[MOST_SPECIES] = {0};
    for (int a = 0; a < MOST_SPECIES; a++) {
        for (int b = 0; b < MOST_SPECIES; b++) pile->threshold[a][b] = -STEEPEST;
        pile->height[a] = pile->species[a] = pile->height_of[a] = 0;
    }
    pile->species_count = (int)job->species;
    pile->fits = 1;
    for (int a = 0; a < job->species; a++) {
        int64_t of = job->smallest_first[a];
        place[of] = a;
        pile->species[a] = (int32_t)of;
        pile->height[a] = pile->height_of[of] = (int32_t)job->grain_height[of];
        for (int b = 0; b < job->species; b++) {
            int64_t surface = job->smallest_first[b];
            pile->threshold[b][a] = (int32_t)job->threshold[of * job->species + surface];
        }
    }
    for (int a = 0; a < MOST_SPECIES; a++) {
        int8_t row[64] = {0};
        for (int b = 0; b < MOST_SPECIES; b++) {
            int32_t threshold = pile->threshold[b][a];
            row[b] = (int8_t)threshold;
            pile->fits &= threshold >= -STEEPEST && threshold + pile->height[b] <= STEEPEST;
        }
        pile->of_surface[a] = _mm512_loadu_si512(row);
    }
    for (int32_t i = 0; i <= wall; i++) {
        int64_t slope = i < wall ? job->height[i] - job->height[i + 1] : job->height[i];
        pile->state[i] = (int32_t)(slope << 3) | place[job->top[i]];
    }
    for (int32_t w = 0; w < pile->words; w++) {
        Bits set[MOST_SPECIES] = {0};
        for (int32_t i = 64 * w; i < 64 * (w + 1) && i <= wall; i++) {
            const int32_t *threshold = pile->threshold[pile->state[i] & 7];
            for (int a = 0; a < N; a++) {
                Bits on = i == wall || (pile->state[i] >> 3) < threshold[a];
                set[a] |= on << (i & 63);
            }
        }
        for (int a = 0; a < N; a++) put_word(pile, N, a, w, set[a]);
    }
}

static void give_back(const Pile *pile, Job *job) {
    int64_t height = 0;
    for (int32_t i = pile->columns - 1; i >= 0; i--) {
        height += pile->state[i] >> 3;
        job->height[i] = height;
        job->top[i] = pile->species[pile->state[i] & 7];
    }
    job->logged = pile->log - job->log;
}

INLINE void pour_of(Pile *pile, Job *job, int N) {
    take_in(pile, job, N);
    if (job->contacts == 1) {
        pour(pile, job, N, ONE);
    } else if (job->contacts >= (int64_t)1 << 32) {
        pour(pile, job, N, ALL);
    } else {
        pour(pile, job, N, SOME);
    }
}

/* Take the steps of `job`; 0, or 1 where there is no memory for it. */
int advance_pile(Job *job) {
    Pile pile = {.columns = (int32_t)job->columns, .contacts = job->contacts, .log = job->log};
    pile.words = (pile.columns + 63) / 64;
    const int N = job->species <= 3 ? (int)job->species : MOST_SPECIES;
    size_t words = (size_t)pile.words, all = 0, begins[LEVELS];
    for (int level = 0; level < LEVELS; level++) {
        begins[level] = all;
        all += (words + 1) * (size_t)N;
        words = (words + 63) / 64;
    }
    Bits *sets = calloc(all, sizeof(Bits));
    pile.state = malloc(sizeof(int32_t) * (size_t)pile.columns);
    if (!sets || !pile.state) return 1;
    for (int level = 0; level < LEVELS; level++) pile.set[level] = sets + begins[level];
    switch (N) {
        case 1: pour_of(&pile, job, 1); break;
        case 2: pour_of(&pile, job, 2); break;
        case 3: pour_of(&pile, job, 3); break;
        default: pour_of(&pile, job, MOST_SPECIES);
    }
    give_back(&pile, job);
    free(sets);
    free(pile.state);
    return 0;
}

/* Put the grains of the log on their stacks; 0, or 1 where a stack has too few places. */
int split(const uint32_t *log, int64_t logged, int64_t places, int8_t *stack, int64_t *grains) {
    for (int64_t n = 0; n < logged; n++) {
        int64_t i = log[n] >> 3;
        if (grains[i] == places) return 1;
        stack[i * places + grains[i]++] = (int8_t)(log[n] & 7);
    }
    return 0;
}

/* So many links of the chain that a window cannot avoid: bits, to a mask, to slopes, to bits. */
int64_t chain(int64_t links) {
    const Bytes height = _mm512_set1_epi8(1), threshold = _mm512_set1_epi8(4);
    Bytes slope = _mm512_setzero_si512();
    Bits set = ~(Bits)0;
    for (int64_t n = 0; n < links; n++) {
        Bits bit = set & -set;
        slope = _mm512_mask_add_epi8(slope, bit, slope, height);
        set = _mm512_cmplt_epi8_mask(slope, threshold);
    }
    return (int64_t)set;
}
