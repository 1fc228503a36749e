/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* Packets of other IDs, one after the other, as rivals of one packet. */
#include "retrolidar_rivals.h"

#include "retrolidar_bits.h"

#include <math.h>

/* What is seen in a window of a packet that has ended in it, or begins. */
struct cut_packet {
    float nats; /* of its dark bits: at the most, until a word is found */
    bool is_found;
    int word;
};

/* Where one packet ends and another begins, and how likely they are about. */
struct two_packets {
    double nats, price;
    int end;
};

static void bound(const struct rl_bits *bits, bool begins, struct cut_packet *cut)
{
    for (int bit = 0; bit <= bits->count; bit++) {
        float weight[RL_PACKET_BITS];
        rl_bits_weigh(bits, begins ? bit : bit - RL_PACKET_BITS, false, weight);
        cut[bit] = (struct cut_packet){.nats = rl_bits_max(weight)};
    }
}

static void find_word(const struct rl_case *judged, int begin, struct cut_packet *cut)
{
    if (!cut->is_found) {
        float weight[RL_PACKET_BITS];
        rl_bits_weigh(&judged->bits, begin, false, weight);
        cut->is_found = true;
        cut->word = rl_codebook_heaviest(judged->codebook, weight, judged->verdict.id);
        cut->nats = cut->word < 0 ? -INFINITY
                                  : rl_bits_sum(judged->codebook->packet[cut->word], weight);
    }
}

/* Find the likeliest two, back to back, by the sums over the bits that they flip. What is seen of
 * the shorter one might be any ID, which has its price. One ID back to back is a packet that
 * repeats, which is tried by itself.
 */
static struct two_packets find_two(const struct rl_case *judged, struct cut_packet *ended,
                                   struct cut_packet *begun)
{
    const int count = judged->bits.count;
    float weight[RL_PACKET_BITS];
    const float all = rl_bits_weigh(&judged->bits, count, false, weight);
    struct two_packets best = {.nats = -RL_MAX_MARGIN, .end = -1};
    for (int end = 1; end < count; end++) {
        struct cut_packet *one = &ended[end], *other = &begun[end];
        if ((double)(all + one->nats + other->nats) > best.nats) {
            find_word(judged, end - RL_PACKET_BITS, one);
        }
        if ((double)(all + one->nats + other->nats) > best.nats) {
            find_word(judged, end, other);
        }
        const int seen = end < count - end ? end : count - end;
        const double price = log(2.0) * (seen < RL_ID_BITS ? seen : RL_ID_BITS);
        const double nats = (double)(all + one->nats + other->nats) - price;
        if (nats > best.nats) {
            best = (struct two_packets){nats, price, end};
        }
    }
    return best;
}

/* How likely two packets are at best, each shifted, as they need not keep time with the bits. */
static double shift_two(struct rl_window *window, struct rl_transmission *one,
                        struct rl_transmission *other)
{
    double best = rl_window_try_two(window, one, other);
    for (int moved = 0; moved < 2; moved++) {
        struct rl_transmission *packet = moved ? one : other;
        const double start_s = packet->start_s;
        double best_s = start_s;
        for (int phase = -RL_PHASES / 2; phase <= RL_PHASES / 2; phase++) {
            packet->start_s = start_s + phase * packet->bit_s / RL_PHASES;
            const double likelihood = rl_window_try_two(window, one, other);
            if (likelihood > best) {
                best = likelihood;
                best_s = packet->start_s;
            }
        }
        packet->start_s = best_s;
    }
    return best;
}

double rl_rivals_successive_margin(const struct rl_case *judged)
{
    struct cut_packet ended[RL_MAX_BITS + 1], begun[RL_MAX_BITS + 1];
    bound(&judged->bits, false, ended);
    bound(&judged->bits, true, begun);
    const struct two_packets two = find_two(judged, ended, begun);
    if (two.end < 0) {
        return RL_MAX_MARGIN;
    }
    const int begin[2] = {two.end - RL_PACKET_BITS, two.end};
    const int word[2] = {ended[two.end].word, begun[two.end].word};
    const double bit_s = judged->verdict.transmission.bit_s;
    struct rl_transmission packet[2];
    for (int i = 0; i < 2; i++) {
        packet[i] = (struct rl_transmission){.bits = judged->codebook->packet[word[i]],
                                             .start_s = judged->bits.begin_s + begin[i] * bit_s,
                                             .bit_s = bit_s};
    }
    const double likelihood = shift_two(judged->window, &packet[0], &packet[1]);
    return fmin(judged->own + two.price - likelihood, RL_MAX_MARGIN);
}
