/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
#include "retrolidar_search.h"

#include "retrolidar_packet.h"
#include "retrolidar_target.h"

#include <math.h>
#include <string.h>

enum {
    EIGHTHS = 8,       /* of a bit, by which packets that ended are tried */
    QUARTERS = 4,      /* of a bit, by which stretches are tried first */
    KEPT = 4,          /* stretches of a source whose words are searched */
    EDGES = RL_BITS * RL_MOST_PACKETS + 1,
    PREAMBLE_BITS = RL_BITS - RL_WORD_BITS,
    BEFORE_BITS = 12, /* of samples before a packet, to tell the level */
};

/* Variance of a source, in that of its noise, from which it is strong. */
static const double STRONG = 4.0;
static const float FAINT_WALK = 0.01f, STRONG_WALK = 0.1f;
/* Coarse templates explain no more than this, and some words more than the bound by this factor. */
static const float MOST_EXPLAINED = 0.995f, BOUND_SLACK = 1.1f;
/* Steps between clocks, such that the ends of a window are off by a quarter of a bit at the most. */
static const double CLOCK_BITS = 0.25;

/* A time within an exposure. */
struct edge {
    int row;
    float share; /* of the exposure, 0 to 1 */
};

/* What is tried: where bits begin and end. */
struct trial {
    double end_s, bit_s;
    int packets;
    struct rl_energy energy;
};

int64_t rl_search_bytes(int rows)
{
    return (int64_t)(rows + 1) *
           (4 * RL_LANES * (int64_t)sizeof(float) + 2 * (int64_t)sizeof(float) + 1);
}

void rl_search_start(struct rl_search *search, const struct rl_samples *samples, int rows,
                     double bit_s, void *memory)
{
    struct rl_view *view = &search->view;
    search->samples = samples;
    search->bit_s = bit_s;
    search->most_skew = 0.03;
    search->frames_a_bit = 0.0;
    search->whitening[0].walk = FAINT_WALK;
    search->whitening[1].walk = STRONG_WALK;
    view->light = memory;
    view->total = view->light + rows + 1;
    view->power = view->total + rows + 1;
    view->valid = view->power + rows + 1;
    view->signal = (float *)(view->valid + rows + 1);
    view->scratch = view->signal + rows + 1;
    view->known = (uint8_t *)(view->scratch + rows + 1);
}

/* Tabulate what smoothing takes off two bits that are some bits apart: the kernel of the level, an
 * exponential to both sides, under two boxes of a bit.
 */
static void plan(struct rl_search *search)
{
    enum { FINE = 16 };
    const double frames = search->bit_s / search->samples->period_s;
    if (fabs(frames - search->frames_a_bit) < 0.02 * frames) {
        return;
    }
    search->frames_a_bit = frames;
    for (int which = 0; which < 2; which++) {
        struct rl_whitening *whitening = &search->whitening[which];
        const double q = (double)whitening->walk;
        const double memory = 1.0 + q / 2 - sqrt(q + q * q / 4);
        const double height = (1.0 - memory) / (1.0 + memory);
        for (int lag = 0; lag < RL_BITS; lag++) {
            double sum = 0.0;
            for (int i = 0; i < FINE; i++) {
                for (int j = 0; j < FINE; j++) {
                    sum += pow(memory, fabs(lag + (double)(i - j) / FINE) * frames);
                }
            }
            whitening->energy.smooth[lag] =
                (float)((lag ? 2.0 : 1.0) * height * sum * frames * frames / (FINE * FINE));
        }
        rl_codebook_smooth(&search->codebook, &whitening->energy, whitening->smooth);
    }
}

/* Take the level off the samples of a lane: z = x - l, where l is the smoothest of all levels,
 * the sum of squares of z and of steps of l over q being least. Erasures tell nothing.
 */
static void whiten_lane(struct rl_search *search, int source, int lane, float walk)
{
    struct rl_view *view = &search->view;
    const int rows = view->rows;
    float *signal = view->signal, *pivot = view->scratch;
    rl_target_column(search->samples, source, view->first, rows, signal, view->known, pivot);
    float mean = 0.0f;
    for (int row = 0; row < rows; row++) {
        mean += signal[row];
    }
    mean /= (float)rows;
    const float stiff = 1.0f / walk;
    float before = 0.0f;
    for (int row = 0; row < rows; row++) {
        /* An erasure bears nothing on the level. */
        const float weight = view->known[row] ? 1.0f : 1e-3f;
        const float ends = (row > 0 ? stiff : 0.0f) + (row + 1 < rows ? stiff : 0.0f);
        const float under = row > 0 ? stiff * pivot[row - 1] : 0.0f;
        pivot[row] = 1.0f / (weight + ends - stiff * under);
        before = (weight * (signal[row] - mean) + stiff * before) * pivot[row];
        view->light[row][lane] = before;
    }
    for (int row = rows - 2; row >= 0; row--) {
        view->light[row][lane] += stiff * pivot[row] * view->light[row + 1][lane];
    }
    float total = 0.0f, power = 0.0f, valid = 0.0f;
    for (int row = 0; row < rows; row++) {
        const float value = signal[row] - mean;
        const float z = view->known[row] ? value - view->light[row][lane] : 0.0f;
        view->light[row][lane] = z;
        view->total[row][lane] = total;
        view->power[row][lane] = power;
        view->valid[row][lane] = valid;
        total += z;
        power += z * value;
        valid += view->known[row] ? 1.0f : 0.0f;
    }
    view->total[rows][lane] = total;
    view->power[rows][lane] = power;
    view->valid[rows][lane] = valid;
}

static void locate(const struct rl_search *search, double time_s, struct edge *edge)
{
    const struct rl_view *view = &search->view;
    const double *begin_s = search->samples->begin_s + view->first;
    const double *end_s = search->samples->end_s + view->first;
    int row = (int)((time_s - begin_s[0]) / search->samples->period_s);
    row = row < 0 ? 0 : row >= view->rows ? view->rows - 1 : row;
    while (row > 0 && begin_s[row] > time_s) {
        row--;
    }
    while (row + 1 < view->rows && begin_s[row + 1] <= time_s) {
        row++;
    }
    const double share = (time_s - begin_s[row]) / (end_s[row] - begin_s[row]);
    edge->row = row;
    edge->share = (float)fmin(fmax(share, 0.0), 1.0);
}

/* Find the edges of a trial's bits, and the energy of bits between them. */
static void cut(const struct rl_search *search, struct trial *trial, struct edge *edges)
{
    const int bits = RL_BITS * trial->packets;
    float own = 0.0f, adjacent = 0.0f;
    for (int bit = 0; bit <= bits; bit++) {
        locate(search, trial->end_s - (bits - bit) * trial->bit_s, &edges[bit]);
        if (bit == 0) {
            continue;
        }
        const struct edge from = edges[bit - 1], to = edges[bit];
        if (from.row == to.row) {
            own += (to.share - from.share) * (to.share - from.share);
        } else {
            own += (1.0f - from.share) * (1.0f - from.share) + (float)(to.row - from.row - 1) +
                   to.share * to.share;
        }
        adjacent += to.share * (1.0f - to.share);
    }
    trial->energy.own = own / (float)bits;
    trial->energy.adjacent = adjacent / (float)bits;
}

/* Sum the light of each bit, packets on top of each other; positive = dark. */
static void integrate(const struct rl_view *view, const struct trial *trial,
                      const struct edge *edges, float soft[RL_BITS][RL_LANES])
{
    float before[RL_LANES];
    memset(soft, 0, RL_BITS * sizeof *soft);
    for (int bit = 0, edge = 0; edge <= RL_BITS * trial->packets; edge++) {
        const float *light = view->light[edges[edge].row], *total = view->total[edges[edge].row];
        const float share = edges[edge].share;
        for (int lane = 0; lane < RL_LANES; lane++) {
            const float until = total[lane] + share * light[lane];
            if (edge > 0) {
                soft[bit][lane] += before[lane] - until;
            }
            before[lane] = until;
        }
        if (edge > 0) {
            bit = bit + 1 == RL_BITS ? 0 : bit + 1;
        }
    }
}

/* Half of the samples times the logarithm of what is left of the variance. */
static float nats_of(float squared, float power, float samples)
{
    return -0.5f * samples * log1pf(-fminf(squared / power, MOST_EXPLAINED));
}

/* The bits, from one on, whose soft bits are dark. */
static uint32_t dark_bits(const float *soft, int first)
{
    uint32_t dark = 0;
    for (int bit = first; bit < RL_BITS; bit++) {
        dark |= soft[bit] > 0.0f ? 1u << (RL_BITS - 1 - bit) : 0u;
    }
    return dark;
}

/* The sequence of bits that explains most: from the signs of the soft bits, by turning one at a time.
 * In a long run the level is taken for the light of its bits, and their signs tell little.
 */
static uint32_t best_bits(const struct rl_energy *energy, const float *soft)
{
    uint32_t bits = dark_bits(soft, 0);
    float sum = 0.0f;
    for (int bit = 0; bit < RL_BITS; bit++) {
        sum += fmaxf(soft[bit], 0.0f);
    }
    float best = bits ? sum * sum / rl_energy_of(energy, bits) : 0.0f;
    for (int turned = 0; turned >= 0;) {
        float sum_then = sum;
        turned = -1;
        for (int bit = 0; bit < RL_BITS; bit++) {
            const uint32_t mask = 1u << (RL_BITS - 1 - bit);
            const float other = bits & mask ? sum - soft[bit] : sum + soft[bit];
            const float squared = other > 0.0f && (bits ^ mask) != 0
                                      ? other * other / rl_energy_of(energy, bits ^ mask)
                                      : 0.0f;
            if (squared > best) {
                best = squared;
                turned = bit;
                sum_then = other;
            }
        }
        if (turned >= 0) {
            bits ^= 1u << (RL_BITS - 1 - turned);
            sum = sum_then;
        }
    }
    return bits;
}

static void keep(struct rl_hits *hits, const struct rl_hit *hit)
{
    int at = hits->count;
    for (int i = 0; i < hits->count; i++) {
        if (hits->hit[i].id == hit->id) {
            if (hits->hit[i].nats >= hit->nats) {
                return;
            }
            at = i;
        }
    }
    if (at == RL_HITS) {
        at--;
        if (hits->hit[at].nats >= hit->nats) {
            return;
        }
    } else if (at == hits->count) {
        hits->count++;
    }
    for (; at > 0 && hits->hit[at - 1].nats < hit->nats; at--) {
        hits->hit[at] = hits->hit[at - 1];
    }
    hits->hit[at] = *hit;
}

static void keep_sequence(struct rl_hits *hits, const struct trial *trial, const float *soft,
                          float nats, bool repeats)
{
    int at = 0;
    for (; at < hits->sequences; at++) {
        if (hits->sequence[at].bit_s == trial->bit_s) {
            break;
        }
    }
    if (at == RL_SEQUENCES) {
        at = 0;
        for (int i = 1; i < RL_SEQUENCES; i++) {
            at = hits->sequence[i].nats < hits->sequence[at].nats ? i : at;
        }
    }
    if (at == hits->sequences) {
        hits->sequences++;
    } else if (nats <= hits->sequence[at].nats) {
        return;
    }
    struct rl_sequence *sequence = &hits->sequence[at];
    sequence->nats = nats;
    sequence->repeats = repeats;
    sequence->start_s = trial->end_s - RL_BITS * trial->packets * trial->bit_s;
    sequence->bit_s = trial->bit_s;
    memcpy(sequence->soft, soft, sizeof sequence->soft);
    sequence->energy = trial->energy;
}

/* What is asked of a hit. */
struct demand {
    float least, most_beyond;
    const float *word_smooth;
};

/* Search one lane of a trial: for sequences of bits, and for words that begin with one of its first
 * `shifts` bits; all 31 if it is a stretch.
 */
static void search_words(struct rl_search *search, const struct trial *trial,
                         float soft_lanes[RL_BITS][RL_LANES], int lane, float power,
                         float samples, int shifts, const struct demand *demand,
                         struct rl_hits *hits)
{
    const bool repeats = shifts == RL_BITS;
    float soft[2 * RL_BITS], free = 0.0f;
    for (int bit = 0; bit < RL_BITS; bit++) {
        soft[bit] = soft[bit + RL_BITS] = soft_lanes[bit][lane];
        free += fmaxf(soft[bit], 0.0f);
    }
    const float packets = (float)trial->packets;
    const uint32_t preamble = (uint32_t)RL_PREAMBLE << RL_WORD_BITS;
    const double start_s = trial->end_s - RL_BITS * trial->packets * trial->bit_s;
    const float free_energy = rl_energy_of(&trial->energy, dark_bits(soft, 0)) * packets;
    const float free_nats = nats_of(free * free / free_energy, power, samples);
    if (BOUND_SLACK * free_nats < demand->least) {
        return;
    }
    keep_sequence(hits, trial, soft, free_nats, repeats);
    for (int shift = 0; shift < shifts; shift++) {
        const float *turned = soft + shift;
        float bound = turned[0] + turned[2] + turned[4] + turned[6];
        for (int bit = PREAMBLE_BITS; bit < RL_BITS; bit++) {
            bound += fmaxf(turned[bit], 0.0f);
        }
        if (!(bound > 0.0f)) {
            continue;
        }
        const float energy = rl_energy_of(&trial->energy, preamble | dark_bits(turned, PREAMBLE_BITS)) * packets;
        const float bound_nats = nats_of(bound * bound / energy, power, samples);
        if (BOUND_SLACK * bound_nats < demand->least || free_nats - bound_nats > demand->most_beyond) {
            continue;
        }
        if (search->words_left == 0) {
            return;
        }
        search->words_left--; extern long WC[4][2]; WC[trial->packets>1?2:repeats][power>2000.f]++;
        struct rl_word best[2];
        rl_codebook_best(&search->codebook, &trial->energy, demand->word_smooth, turned, best);
        for (int i = 0; i < 2 && best[i].index >= 0; i++) {
            const float nats = nats_of(best[i].squared / packets, power, samples);
            if (nats < demand->least) {
                continue;
            }
            /* The packet that began first in the window, or before it. */
            const int bits = shift > 0 ? shift - RL_BITS : 0;
            const struct rl_hit hit = {
                .nats = nats,
                .id = search->codebook.id[best[i].index],
                .repeats = repeats,
                .start_s = start_s + bits * trial->bit_s,
                .bit_s = trial->bit_s,
            };
            keep(hits, &hit);
        }
    }
}

/* The stretches of a lane whose bits stand out most, by any sequence of bits. */
struct kept {
    int count;
    float share[KEPT];
    struct trial trial[KEPT];
};

static void keep_trial(struct kept *kept, int most, const struct trial *trial, float share)
{
    int at = kept->count;
    while (at > 0 && kept->share[at - 1] < share) {
        at--;
    }
    if (at == most) {
        return;
    }
    kept->count += kept->count < most;
    for (int i = kept->count - 1; i > at; i--) {
        kept->share[i] = kept->share[i - 1];
        kept->trial[i] = kept->trial[i - 1];
    }
    kept->share[at] = share;
    kept->trial[at] = *trial;
}

static void window_sums(const struct rl_view *view, const struct trial *trial,
                        const struct edge *edges, float power[RL_LANES], float samples[RL_LANES])
{
    const int from = edges[0].row, to = edges[RL_BITS * trial->packets].row + 1;
    for (int lane = 0; lane < RL_LANES; lane++) {
        samples[lane] = view->valid[to][lane] - view->valid[from][lane];
        /* Bits of which samples are missing have so much less energy. */
        const float share = samples[lane] / (float)(to - from);
        power[lane] = fmaxf(share * (view->power[to][lane] - view->power[from][lane]), 1e-6f);
    }
}

static void look_at_ended(struct rl_search *search, int count, double from_s, double to_s,
                          const struct demand *demand, struct trial *trial, struct rl_hits *hits)
{
    struct edge edges[EDGES];
    float soft[RL_BITS][RL_LANES], power[RL_LANES], samples[RL_LANES];
    const double eighth_s = search->bit_s / EIGHTHS;
    const int clocks = (int)(search->most_skew * RL_BITS / 2 / CLOCK_BITS + 0.999);
    const double skew = search->most_skew / clocks;
    const double newest = floor(to_s / eighth_s);
    bool found = false;
    for (int back = 0; back < EIGHTHS; back++) {
        const double end_s = (newest - back) * eighth_s;
        /* Words end with the newest samples, but what else these may be begins with any phase. */
        const bool has_ended = end_s > from_s;
        if (!has_ended && !found) {
            return;
        }
        for (int clock = -clocks; clock <= clocks; clock++) {
            trial->end_s = end_s;
            trial->bit_s = search->bit_s * (1.0 + clock * skew);
            cut(search, trial, edges);
            integrate(&search->view, trial, edges, soft);
            window_sums(&search->view, trial, edges, power, samples);
            for (int lane = 0; lane < count; lane++) {
                if (has_ended || hits[lane].count > 0) {
                    search_words(search, trial, soft, lane, power[lane], samples[lane],
                                 has_ended ? 1 : 0, demand, &hits[lane]);
                    found |= hits[lane].count > 0;
                }
            }
        }
    }
}

/* By how much the bits of a trial stand out in each lane. */
static void stand_out(const struct rl_search *search, struct trial *trial, float share[RL_LANES])
{
    struct edge edges[EDGES];
    float soft[RL_BITS][RL_LANES], power[RL_LANES], samples[RL_LANES];
    float squares[RL_LANES] = {0.0f};
    cut(search, trial, edges);
    integrate(&search->view, trial, edges, soft);
    window_sums(&search->view, trial, edges, power, samples);
    for (int bit = 0; bit < RL_BITS; bit++) {
        for (int lane = 0; lane < RL_LANES; lane++) {
            squares[lane] += soft[bit][lane] * soft[bit][lane];
        }
    }
    for (int lane = 0; lane < RL_LANES; lane++) {
        share[lane] = squares[lane] / (trial->energy.own * (float)trial->packets * power[lane]);
    }
}

static void look_at_stretches(struct rl_search *search, int count, double to_s,
                              const struct demand *demand, struct trial *trial,
                              struct rl_hits *hits)
{
    struct edge edges[EDGES];
    struct kept kept[RL_LANES];
    float soft[RL_BITS][RL_LANES], power[RL_LANES], samples[RL_LANES], share[RL_LANES];
    const double half_bits = RL_BITS * trial->packets / 2.0;
    const int clocks = (int)(search->most_skew * half_bits / (2 * CLOCK_BITS) + 0.999);
    const double skew = search->most_skew / clocks;
    /* All stretches have the same middle, or up to a bit before. */
    const double middle_s = to_s - half_bits * search->bit_s * (1.0 + search->most_skew);
    memset(kept, 0, sizeof kept);
    for (int clock = -clocks; clock <= clocks; clock++) {
        for (int quarter = 0; quarter < QUARTERS; quarter++) {
            trial->bit_s = search->bit_s * (1.0 + clock * skew);
            trial->end_s = middle_s - quarter * search->bit_s / QUARTERS + half_bits * trial->bit_s;
            stand_out(search, trial, share);
            for (int lane = 0; lane < count; lane++) {
                keep_trial(&kept[lane], KEPT, trial, share[lane]);
            }
        }
    }
    for (int lane = 0; lane < count; lane++) {
        for (int i = 0; i < kept[lane].count; i++) {
            /* Between those that were tried there may be a better one. */
            const struct trial around = kept[lane].trial[i];
            struct kept best = {.count = 0};
            for (int step = -1; step <= 1; step++) {
                for (int half = -1; half <= 1; half++) {
                    const double longer_s = half * skew / 2 * search->bit_s;
                    *trial = around;
                    trial->bit_s += longer_s;
                    trial->end_s += step * search->bit_s / EIGHTHS + half_bits * longer_s;
                    stand_out(search, trial, share);
                    keep_trial(&best, 1, trial, share[lane]);
                }
            }
            *trial = best.trial[0];
            cut(search, trial, edges);
            integrate(&search->view, trial, edges, soft);
            window_sums(&search->view, trial, edges, power, samples);
            search_words(search, trial, soft, lane, power[lane], samples[lane], RL_BITS, demand,
                         &hits[lane]);
        }
    }
}

void rl_search_look(struct rl_search *search, const int *sources, int count, int packets,
                    double from_s, double to_s, double least, double most_beyond,
                    struct rl_hits *hits)
{
    const struct rl_samples *samples = search->samples;
    const double bits =
        packets > 0 ? RL_BITS * packets * (1.0 + search->most_skew) + 2.0
                    : RL_BITS * (1.0 + search->most_skew) + BEFORE_BITS + (to_s - from_s) / search->bit_s;
    const int end = rl_samples_row(samples, to_s - 1e-9) + 1;
    struct rl_view *view = &search->view;
    plan(search);
    view->first = rl_samples_row(samples, to_s - bits * search->bit_s);
    view->rows = (end < samples->count ? end : samples->count) - view->first;
    for (int strong = 0; strong < 2; strong++) {
        struct rl_hits found[RL_LANES];
        int lane_of[RL_LANES], lanes = 0;
        for (int i = 0; i < count; i++) {
            if ((rl_samples_variation(samples, sources[i]) > STRONG) == strong) {
                whiten_lane(search, sources[i], lanes, search->whitening[strong].walk);
                found[lanes].count = found[lanes].sequences = 0;
                lane_of[lanes++] = i;
            }
        }
        if (lanes == 0) {
            continue;
        }
        const struct demand demand = {(float)least, (float)most_beyond,
                                      search->whitening[strong].smooth};
        struct trial trial = {.packets = packets > 0 ? packets : 1,
                              .energy = search->whitening[strong].energy};
        if (packets > 0) {
            look_at_stretches(search, lanes, to_s, &demand, &trial, found);
        } else {
            look_at_ended(search, lanes, from_s, to_s, &demand, &trial, found);
        }
        for (int lane = 0; lane < lanes; lane++) {
            for (int i = 0; found[lane].count > 0 && i < found[lane].sequences; i++) {
                struct rl_sequence *sequence = &found[lane].sequence[i];
                sequence->bits = best_bits(&sequence->energy, sequence->soft);
            }
            hits[lane_of[lane]] = found[lane];
        }
    }
}

long WC[4][2];
void dumpwc(void);
#include <stdio.h>
void dumpwc(void){for(int i=0;i<3;i++)printf("kind %d faint %ld strong %ld\n",i,WC[i][0],WC[i][1]);}
