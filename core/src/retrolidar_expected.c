/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* Packets that are expected where another one of a marker ends or begins. As start and clock are
 * known, the bits are found by least squares, without a search.
 */
#include "retrolidar_detector_state.h"

#include "retrolidar_math.h"

#include <math.h>
#include <string.h>

/* Index of q by which bits are whitened: the most without wandering. */
enum { WALK = RL_WANDERS - 1 };

/* Products of what the light lacks if a bit is dark: of two bits, those of one another twice, and
 * with the signal.
 */
struct bit_products {
    float normal[RL_PACKET_BITS][RL_PACKET_BITS], right[RL_PACKET_BITS];
};

/* Lay out the light of each single dark bit, in memory for templates that are tried. */
static void lay_bits(struct rl_window *window, const struct rl_transmission *packet)
{
    struct rl_whitened *whitened = &window->whitened;
    struct rl_transmission one = *packet;
    for (int bit = 0; bit < RL_PACKET_BITS; bit++) {
        double (*column)[RL_WALK_LANES] =
            whitened->interferer[RL_MAX_INTERFERERS + bit / RL_WALK_LANES];
        one.bits = rl_packet_bit(bit);
        rl_template(&one, window->begin_s, window->end_s, window->rows, window->light);
        for (int i = 0; i < whitened->samples; i++) {
            column[i][bit % RL_WALK_LANES] = window->light[whitened->row[i]];
        }
    }
}

/* Whiten the light of all bits, and find their products less what interferers explain. */
static void multiply_bits(const struct rl_whitened *whitened, struct bit_products *products)
{
    double level[RL_PACKET_BITS] = {0.0};
    float white[RL_PACKET_BITS], shared[RL_PACKET_BITS][RL_MAX_INTERFERERS];
    memset(products, 0, sizeof *products);
    memset(shared, 0, sizeof shared);
    for (int sample = 1; sample < whitened->samples; sample++) {
        for (int bit = 0; bit < RL_PACKET_BITS; bit++) {
            double (*column)[RL_WALK_LANES] =
                whitened->interferer[RL_MAX_INTERFERERS + bit / RL_WALK_LANES];
            const int lane = bit % RL_WALK_LANES;
            const double innovation = column[sample][lane] - column[0][lane] - level[bit];
            level[bit] += whitened->gain[sample][WALK] * innovation;
            white[bit] = (float)(innovation * whitened->scale[sample][WALK]);
            products->right[bit] += white[bit] * (float)whitened->signal[sample][WALK];
            for (int other = 0; other <= bit; other++) {
                products->normal[bit][other] += white[bit] * white[other];
            }
            for (int i = 0; i < whitened->interferers; i++) {
                shared[bit][i] += white[bit] * (float)whitened->interferer[i][sample][WALK];
            }
        }
    }
    for (int bit = 0; bit < RL_PACKET_BITS; bit++) {
        for (int other = 0; other <= bit; other++) {
            for (int i = 0; i < whitened->interferers; i++) {
                products->normal[bit][other] -= shared[bit][i] * shared[other][i];
            }
            products->normal[bit][other] *= other < bit ? 2.0f : 1.0f;
        }
    }
}

/* By how much a packet lowers the squares. */
static float explained(const struct bit_products *products, uint32_t packet)
{
    int dark[RL_PACKET_BITS], count = 0;
    float sum = 0.0f, energy = (float)RL_NO_ENERGY;
    for (int bit = 0; bit < RL_PACKET_BITS; bit++) {
        if ((packet & rl_packet_bit(bit)) != 0) {
            dark[count++] = bit;
            sum += products->right[bit];
        }
    }
    for (int i = 0; sum > 0.0f && i < count; i++) {
        for (int j = 0; j <= i; j++) {
            energy += products->normal[dark[i]][dark[j]];
        }
    }
    return sum > 0.0f ? sum * sum / energy : 0.0f;
}

/* Judge the packet of any ID that explains most in a zone. */
static void judge_any(struct rl_detector *detector, int zone, const struct rl_packet_train *packet,
                      double to_s)
{
    struct rl_window *window = &detector->window;
    const struct rl_codebook *codebook = &detector->search.codebook;
    struct bit_products products;
    struct rl_pending pending = {.channel = zone, .packets = 1, .since_s = -INFINITY};
    pending.hits.reference = window->reference = RL_NO_REFERENCE;
    rl_pool_interference(&detector->pool, (uint64_t)1 << zone, packet->begin_s, to_s, 0, 0,
                         &window->interference);
    rl_window_open(window, zone, false, packet->begin_s, packet->end_s);
    lay_bits(window, &packet->transmission);
    multiply_bits(&window->whitened, &products);
    for (int word = 0; word < codebook->words; word++) {
        struct rl_hit hit = {explained(&products, codebook->packet[word]), codebook->id[word],
                             packet->transmission};
        hit.transmission.bits = codebook->packet[word];
        if (hit.nats > 0.0f) {
            rl_keep_best(pending.hits.hit, &pending.hits.count, RL_TRIED, &hit, sizeof hit);
        }
    }
    if (pending.hits.count > 0) {
        rl_judge(detector, &pending, to_s);
    }
}

void rl_judge_expected(struct rl_detector *detector, double from_s, double to_s)
{
    const struct rl_pool *pool = &detector->pool;
    const struct rl_samples *samples = &detector->samples;
    const double held_s = samples->begin_s[rl_samples_oldest(samples)];
    for (int i = 0; i < pool->count; i++) {
        const struct rl_active_track track = pool->track[i];
        struct rl_transmission packet = track.train.transmission;
        const double packet_s = RL_PACKET_BITS * packet.bit_s;
        packet.dark_before = packet.dark_after = false;
        for (int later = -1; later <= 1 && !packet.repeats; later += 2) {
            packet.start_s = track.train.transmission.start_s + later * packet_s;
            const struct rl_packet_train expected = {packet, packet.start_s,
                                                     packet.start_s + packet_s};
            /* Once it has ended, and after others that overlap it may have been read. */
            for (int tried = 0; tried < RL_TRIED; tried++) {
                const double at_s =
                    expected.end_s + tried * (packet_s + RL_LOOK_BITS * packet.bit_s);
                if (at_s > from_s && at_s <= to_s && packet.start_s >= held_s &&
                    detector->decisions_left > 0 &&
                    !rl_pool_has(pool, track.zones, &expected)) {
                    judge_any(detector, track.zone, &expected, to_s);
                }
            }
        }
    }
}
