/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
#include "retrolidar_successive.h"

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

static void find_word(const struct rl_codebook *codebook, const struct rl_bits *bits, int begin,
                      uint16_t id, struct cut_packet *cut)
{
    if (!cut->is_found) {
        float weight[RL_PACKET_BITS];
        rl_bits_weigh(bits, begin, false, weight);
        cut->is_found = true;
        cut->word = rl_codebook_heaviest(codebook, weight, id);
        cut->nats =
            cut->word < 0 ? -INFINITY : rl_bits_sum(codebook->packet[cut->word], weight);
    }
}

/* Find the likeliest two, back to back, by the sums over the bits that they flip. What is seen of
 * the shorter one might be any ID, which has its price. One ID back to back is a packet that
 * repeats, which is tried by itself.
 */
static struct two_packets find_two(const struct rl_codebook *codebook, const struct rl_bits *bits,
                                   uint16_t id, struct cut_packet *ended, struct cut_packet *begun)
{
    float weight[RL_PACKET_BITS];
    const float all = rl_bits_weigh(bits, bits->count, false, weight);
    struct two_packets best = {.nats = -RL_MAX_MARGIN, .end = -1};
    for (int end = 1; end < bits->count; end++) {
        struct cut_packet *one = &ended[end], *other = &begun[end];
        if ((double)(all + one->nats + other->nats) > best.nats) {
            find_word(codebook, bits, end - RL_PACKET_BITS, id, one);
        }
        if ((double)(all + one->nats + other->nats) > best.nats) {
            find_word(codebook, bits, end, id, other);
        }
        const int seen = end < bits->count - end ? end : bits->count - end;
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

double rl_successive_margin(struct rl_window *window, const struct rl_codebook *codebook,
                            const struct rl_bits *bits, const struct rl_transmission *transmission,
                            double own, uint16_t id)
{
    struct cut_packet ended[RL_MAX_BITS + 1], begun[RL_MAX_BITS + 1];
    bound(bits, false, ended);
    bound(bits, true, begun);
    const struct two_packets two = find_two(codebook, bits, id, ended, begun);
    if (two.end < 0) {
        return RL_MAX_MARGIN;
    }
    const int begin[2] = {two.end - RL_PACKET_BITS, two.end};
    const int word[2] = {ended[two.end].word, begun[two.end].word};
    struct rl_transmission packet[2];
    for (int i = 0; i < 2; i++) {
        packet[i] = (struct rl_transmission){.bits = codebook->packet[word[i]],
                                             .start_s =
                                                 bits->begin_s + begin[i] * transmission->bit_s,
                                             .bit_s = transmission->bit_s};
    }
    return fmin(own + two.price - shift_two(window, &packet[0], &packet[1]), RL_MAX_MARGIN);
}
