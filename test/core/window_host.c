/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 *
 * Answers questions to the core's statistics, a line each, on standard input. Its numbers come with
 * all their digits.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "retrolidar_codebook.h"
#include "retrolidar_decide.h"
#include "retrolidar_packet.h"
#include "retrolidar_target.h"
#include "retrolidar_track.h"

enum { KEPT = 1100, LINE = 1 << 20 };

static struct rl_samples samples;
static struct rl_window window;
static struct rl_codebook codebook;
static void *samples_memory, *window_memory;

static double number(void)
{
    const char *word = strtok(NULL, " \n");
    return word == NULL ? 0.0 : strtod(word, NULL);
}

static int whole(void)
{
    return (int)number();
}

static void tell(double value)
{
    printf("%.17g ", value);
}

static void forget(void)
{
    free(samples_memory);
    free(window_memory);
    samples_memory = window_memory = NULL;
}

/* rows columns floor slope ambient bit_s */
static void begin(void)
{
    const int rows = whole(), columns = whole();
    struct rl_noise_law law;
    law.floor = number();
    law.slope = number();
    law.ambient = number();
    forget();
    samples_memory = calloc(1, (size_t)rl_samples_bytes(rows, columns, KEPT));
    window_memory = calloc(1, (size_t)rl_window_bytes(KEPT));
    rl_samples_start(&samples, rows, columns, KEPT, samples_memory, &law, number());
    rl_window_start(&window, &samples, KEPT, window_memory);
}

/* stamp_ns, then signal, distance and status of each zone */
static void frame(void)
{
    float signal[RL_MOST_ZONES], distance[RL_MOST_ZONES], ambient[RL_MOST_ZONES] = {0.0f};
    uint8_t status[RL_MOST_ZONES];
    const int64_t stamp_ns = strtoll(strtok(NULL, " \n"), NULL, 10);
    for (int zone = 0; zone < samples.zones; zone++) {
        signal[zone] = (float)number();
        distance[zone] = (float)number();
        status[zone] = (uint8_t)whole();
    }
    if (samples.count == 0) {
        rl_samples_clear(&samples, stamp_ns);
    }
    tell(rl_samples_push(&samples, stamp_ns, signal, distance, ambient, status));
}

/* source: period, then begin, end, signal and validity of each row that is held */
static void held(void)
{
    const int source = whole();
    tell(samples.period_s);
    for (int row = 0; row < samples.count; row++) {
        const size_t at = rl_sample(&samples, source, row);
        tell(samples.begin_s[row]);
        tell(samples.end_s[row]);
        tell((double)samples.signal[at]);
        tell(samples.valid[at]);
    }
}

/* source: signal and validity of each row that is held, of the target in question */
static void column(void)
{
    const struct rl_column seen =
        rl_target_column(&samples, whole(), 0, samples.count, &window.room);
    for (int row = 0; row < samples.count; row++) {
        tell((double)seen.signal[row]);
        tell(seen.valid[row]);
    }
}

/* Tell which samples the window is of. */
static void tell_window(void)
{
    tell(window.null);
    tell(window.first);
    tell(window.rows);
}

/* source from_s to_s, then other sources */
static void open_window(void)
{
    const int source = whole();
    const double from_s = number(), to_s = number();
    rl_window_open(&window, source, from_s, to_s);
    for (const char *word; (word = strtok(NULL, " \n")) != NULL;) {
        rl_window_add(&window, atoi(word));
    }
    tell_window();
}

/* from_s to_s */
static void hide(void)
{
    const double from_s = number(), to_s = number();
    rl_window_hide(&window, from_s, to_s);
    tell_window();
}

static struct rl_sending sending(void)
{
    struct rl_sending given;
    given.bits = (uint32_t)number();
    given.repeats = whole() != 0;
    given.start_s = number();
    given.bit_s = number();
    given.brightening_s = number();
    return given;
}

/* A sending: log likelihood; then that, gain and variance of each source. */
static void try_sending(void)
{
    const struct rl_sending given = sending();
    tell(rl_window_try(&window, &given));
    for (int i = 0; i < window.sources; i++) {
        tell(window.fit[i].log_likelihood);
        tell(window.fit[i].gain);
        tell(window.fit[i].variance);
    }
}

/* source packets to_s, then ID, repeats, start_s and bit_s of some hits, of which the first is
 * judged, whatever it is worth
 */
static void decide(void)
{
    const int source = whole(), packets = whole();
    const double to_s = number();
    const struct rl_demands demands = {
        .evidence = 1e-3,
        .word = 1e6,
        .margin = -1e6,
        .bit_s = samples.dark_s / 12.0,
        .most_skew = 0.03,
    };
    struct rl_hits hits;
    struct rl_verdict verdict;
    memset(&hits, 0, sizeof hits);
    for (const char *word; (word = strtok(NULL, " \n")) != NULL;) {
        struct rl_hit *hit = &hits.hit[hits.count++];
        hit->id = (uint16_t)atoi(word);
        hit->repeats = whole() != 0;
        hit->start_s = number();
        hit->bit_s = number();
    }
    verdict = rl_decide(&window, &codebook, &demands, source, &hits.hit[0], &hits, packets,
                        -INFINITY, -INFINITY, to_s);
    tell(verdict.reason);
    tell(verdict.evidence);
    tell(verdict.word);
    tell(verdict.margin);
    tell(verdict.sending.start_s);
    tell(verdict.sending.bit_s);
    tell(verdict.sending.brightening_s);
    tell(window.first);
    tell(window.rows);
    for (int i = 0; i < window.sources; i++) {
        tell(window.source[i]);
    }
}

/* noise, then signal, validity and light of each row: what is explained and all; the gains */
static void track(void)
{
    static float signal[KEPT];
    static uint8_t valid[KEPT];
    static double light[KEPT];
    double gain[RL_KNOTS];
    const double noise = number();
    int rows = 0;
    for (const char *word; (word = strtok(NULL, " \n")) != NULL; rows++) {
        signal[rows] = strtof(word, NULL);
        valid[rows] = (uint8_t)whole();
        light[rows] = number();
    }
    const struct rl_track fit = rl_track_fit(signal, valid, light, rows, noise, gain);
    tell(fit.explained);
    tell(fit.all);
    for (int knot = 0; knot < RL_KNOTS; knot++) {
        tell(gain[knot]);
    }
}

/* IDs */
static void start_codebook(void)
{
    static uint16_t ids[RL_MOST_WORDS];
    int count = 0;
    for (const char *word; (word = strtok(NULL, " \n")) != NULL;) {
        ids[count++] = (uint16_t)atoi(word);
    }
    rl_codebook_start(&codebook, ids, count);
    tell(codebook.words);
}

/* least own adjacent smooth pair decay, then soft bits: ID and square of the two best */
static void best(void)
{
    static struct rl_smooth smooth;
    struct rl_energy energy;
    struct rl_word words[2];
    float soft[RL_PACKET_BITS];
    const float least = (float)number();
    energy.own = (float)number();
    energy.adjacent = (float)number();
    energy.smooth = (float)number();
    energy.pair = (float)number();
    energy.decay = (float)number();
    for (int bit = 0; bit < RL_PACKET_BITS; bit++) {
        soft[bit] = (float)number();
    }
    rl_codebook_smooth(&codebook, &energy, &smooth);
    rl_codebook_best(&codebook, &energy, &smooth, soft, least, words);
    for (int i = 0; i < 2; i++) {
        tell(words[i].index < 0 ? -1 : codebook.id[words[i].index]);
        tell((double)words[i].squared);
    }
}

/* An ID that is none, then weights of bits: the ID of the heaviest packet. */
static void heaviest(void)
{
    float weight[RL_PACKET_BITS];
    const uint16_t id = (uint16_t)whole();
    for (int bit = 0; bit < RL_PACKET_BITS; bit++) {
        weight[bit] = (float)number();
    }
    const int word = rl_codebook_heaviest(&codebook, weight, id);
    tell(word < 0 ? -1 : codebook.id[word]);
}

int main(void)
{
    static const struct {
        const char *name;
        void (*answer)(void);
    } QUESTIONS[] = {
        {"begin", begin}, {"frame", frame},   {"held", held},     {"column", column},
        {"open", open_window}, {"hide", hide}, {"try", try_sending}, {"decide", decide},
        {"track", track}, {"codebook", start_codebook}, {"best", best}, {"heaviest", heaviest},
    };
    const size_t questions = sizeof QUESTIONS / sizeof *QUESTIONS;
    static char line[LINE];
    while (fgets(line, sizeof line, stdin) != NULL) {
        const char *question = strtok(line, " \n");
        size_t which = 0;
        while (which < questions && strcmp(question, QUESTIONS[which].name) != 0) {
            which++;
        }
        if (which == questions) {
            return 2;
        }
        QUESTIONS[which].answer();
        putchar('\n');
        fflush(stdout);
    }
    forget();
    return 0;
}
