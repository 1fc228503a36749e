# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Parts of the core's decision: what a part does, and the line that makes it work."""

from evaluation.bench.changed_core import Part


def _call(file: str, call: str) -> Part:
    return Part(file, call, call.replace(call.strip(), ';'))


PARTS = {
    'earlier packets fitted along': Part(
        'interferers', 'i < interference->count; i++', 'i < 0; i++'
    ),
    'earlier packets: gains that change': Part('interferers', 'changes < 2;', 'changes < 1;'),
    'earlier packets: gains of either sign': Part('interferers', 'light, true)', 'light, false)'),
    'earlier packets: from their start on': Part('template', 'floor(before + WHOLE)', 'before'),
    'the next packet without a search': _call(
        'process_frame', '    judge_next(detector, from_s, to_s);'
    ),
    'expected packets of any ID without a search': _call(
        'process_frame', '    rl_judge_expected(detector, from_s);'
    ),
    'expected packets: no price of a start': Part(
        'decide', 'return judged->is_expected ? RL_COST_OF_CHANCE : 0.0', 'return 0.0'
    ),
    'expected packets: not one after two': Part(
        'pool', 'ended == 1 || followed == 1', 'ended + followed > 0'
    ),
    'search of the residual': _call(
        'process_frame',
        '        search_residual(detector, floor(from_s / slot_s) * slot_s, to_s);',
    ),
    'search of the residual: gains for a level that hardly wanders': Part(
        'whitened', 'null_walk < RL_WANDERS ?', 'null_walk < RL_WALKS ?'
    ),
    'residual searched again once it is known': Part(
        'process_frame', 'again ? anew_s : from_s', 'from_s'
    ),
    'search of the residual: sums of zones, too': Part(
        'process_frame',
        '(zones & subtracted) != 0 && rest[channel] > RL_ACTIVE',
        'channel < samples->zones && (zones & subtracted) != 0 && rest[channel] > RL_ACTIVE',
    ),
    'search of the residual: zones beside, too': Part(
        'pool', 'end_s > since_s ? track->near', 'end_s > since_s ? track->zones'
    ),
    'residual searched again: zones beside, too': Part(
        'pool', 'read_anew |= track->near', 'read_anew |= track->zones'
    ),
    'pairs of packets': Part(
        'judge', 'may_hide && judge_pair(', 'may_hide && false && judge_pair('
    ),
    'pairs of packets: others of the same sum': Part(
        'judge', '? rl_pair_margin(', '? RL_MAX_MARGIN + 0.0 * rl_pair_margin('
    ),
    'pairs of packets: one of them is known': Part(
        'judge',
        'fmin(verdict.margin, margin)',
        'fmin(verdict.margin, RL_MAX_MARGIN + 0.0 * margin)',
    ),
    'pairs of packets: sent together with a lone one': Part(
        'judge', 'if (found.hits.count == 0 && !one', 'if (false && !one'
    ),
    'pairs of packets: whole ones only': Part(
        'pair', 'return may_be_incomplete(', 'return false && may_be_incomplete('
    ),
    'pairs of packets: in the window of a lone one': Part(
        'pair',
        'first.begin_s = second.begin_s = lone->begin_s;\n'
        '    first.end_s = second.end_s = lone->end_s;',
        '(void)lone;',
    ),
    'what has appeared, from fewer bits': _call(
        'process_frame', '        search_appeared(detector, to_s);'
    ),
    'what has appeared: less its first sample': Part(
        'process_frame',
        '*since_s == INFINITY ? to_s :',
        '*since_s == INFINITY ? detector->samples.begin_s[detector->samples.count - 1] :',
    ),
    'what has appeared: energy of bits seen': Part(
        'hits', 'trial->seen, entry->shift', 'RL_ALL_BITS, entry->shift'
    ),
    'what has appeared: bits in order of time': Part(
        'codebook',
        'rl_rotate_bits(packet, first) & seen',
        'packet & rl_rotate_bits(seen, RL_PACKET_BITS - first)',
    ),
    'what has appeared: all starts kept': Part(
        'hits', 'RL_ALL_BITS ? RL_PACKET_BITS', 'RL_ALL_BITS ? RL_HITS'
    ),
    'what has appeared: with each bit': Part(
        'process_frame',
        'comes(bit_s, from_s, to_s)',
        'comes(2.0 * bit_s, from_s, to_s)',
    ),
    'the last packet with every other bit': Part(
        'process_frame', 'STRETCH_BITS = 2', 'STRETCH_BITS = RL_LOOK_BITS'
    ),
    'lone packets': _call(
        'process_frame', '    search(detector, channels, count, 0, from_s, to_s, -INFINITY);'
    ),
    'several packets combined': Part('process_frame', 'round < rounds &&', 'round < 1 &&'),
    'sums of zones': Part('process_frame', 'true, RL_MAX_ZONES, channels', 'true, 1, channels'),
    'sums of zones: erased by zones that vary': Part(
        'samples', '2.0 * variance < ', '0.0 * variance < '
    ),
    'sums of more than 2x2 zones': Part(
        'process_frame', 'true, RL_MAX_ZONES, channels', 'true, 4, channels'
    ),
    'word test: bits turned': Part('bits', 'if (gained > better) {', 'if (false) {'),
    'word test: bits of the search': Part('bits', 'i < judged->hits->sequences &&', 'i < 0 &&'),
    'margin to other IDs': Part(
        'decide',
        'if (verdict->margin < judged->thresholds->margin) {',
        'if (false) {',
    ),
    'margin: less what other bits explain, among others': Part(
        'decide', '? fmax(judged->verdict.word, 0.0)', '? 0.0'
    ),
    'margin and word test: a price of a start among others': Part(
        'decide', 'is_among_others(judged) && !judged->is_expected', 'false'
    ),
    'margin: lone packets against others that repeat': Part(
        'rivals',
        'find_rival(judged, begin, true, &rivals);',
        'if (judged->verdict.transmission.repeats) find_rival(judged, begin, true, &rivals);',
    ),
    'margin: other IDs one after the other': Part(
        'decide',
        'margin = fmin(margin, rl_rivals_successive_margin(',
        'fmin(margin, rl_rivals_successive_margin(',
    ),
    'margin: markers that appear or vanish': Part(
        'decide',
        'margin = fmin(margin, rl_rivals_part_margin(',
        'fmin(margin, rl_rivals_part_margin(',
    ),
    'margin: the next packet of a known marker': Part(
        'rivals', 'fmax(nearest, rl_rivals_next(judged))', 'nearest'
    ),
    'zone by zone: judged again': Part('judge', '.zones != RL_SUMMED) {', '.zones != 0) {'),
    'gains that change along the packet': Part(
        'decide', 'verdict->packets == 1 ? rl_window_follow_gain', 'false ? rl_window_follow_gain'
    ),
    'word test: expected packets': Part('decide', 'word + saved_start(judged) -', 'word -'),
    'word test: bits that are not known': Part('decide', 'fmax(unknown, 0.0)', '0.0 * unknown'),
    'word test: two packets together': Part('decide', 'judged->word_before;', '0.0;'),
    'word test: unknown bits of what appeared': Part(
        'decide', 'return 2.0 * log(2.0);', 'return log(2.0);'
    ),
    'word test: a preamble that is not known': Part(
        'decide', '2.0 * preamble > RL_PREAMBLE_BITS', 'false && preamble > 0.0'
    ),
    'bits that touch a packet': Part(
        'observation', '!transmission->repeats && find_neighbours(', 'false && find_neighbours('
    ),
    'other clocks': Part('decide', 'other > judged->thresholds->word ? ', 'false ? '),
    'readings keep time with packets': Part(
        'pool', 'until_s = packets_end_s < verdict->end_s +', 'until_s = 1.0 < 0.0 *'
    ),
    'a packet that repeats has repeated': Part(
        'decide', '!has_repeated(', 'false && !has_repeated('
    ),
    'a packet that repeats is no lone one': Part(
        'decide',
        '&& may_be_lone(judged)',
        '&& false && may_be_lone(judged)',
    ),
    'stretches judged as lone packets, too': Part(
        'judge', 'verdict.reason != RL_INCOMPLETE ||', 'true || verdict.reason != RL_INCOMPLETE ||'
    ),
    'more evidence for few changes': Part(
        'decide', 'cost = 2.0 * RL_COST_OF_CHANCE', 'cost = 0.0 * RL_COST_OF_CHANCE'
    ),
    'more evidence where levels wander': Part(
        'decide', 'judged->thresholds->wandering : 0.0', '0.0 : 0.0'
    ),
    'search: three ways to follow the level': Part(
        'search', '{0.01f, 0.1f, 0.002f}', '{0.01f, 0.01f, 0.01f}'
    ),
    'two targets of a zone told apart': Part(
        'target',
        'samples->interference_removed[channel] ||',
        'true || samples->interference_removed[channel] ||',
    ),
    'two targets: the marker may be the dimmer one': Part(
        'observation', 'if (judged->window->column.has_two_targets &&', 'if (false &&'
    ),
    'zones: those near the reading only': Part(
        'placement', 'if (is_near(samples, reading, zone))', 'if (true)'
    ),
    'zones: light that is not known': Part('placement', 'ALIKE * amplitude->unknown[zone]', '0.0'),
    'zones: by samples of dark bits': Part('amplitude', 'dark > 2.0 ?', 'false ?'),
    'range: unsure where no zone surely sees the packet': Part(
        'placement', 'is_seen ? 0.0', 'true ? 0.0'
    ),
    'range: mean of all zones': Part('placement', 'i < placement->zones; i++', 'i < 1; i++'),
    'range: other markers fitted along': Part(
        'placement', 'seen->others < RL_MAX_OTHERS;', 'seen->others < 0;'
    ),
    'range: other markers beside, too': Part(
        'placement', 'track->near >> zone & 1u', 'track->zones >> zone & 1u'
    ),
    'range: background subtracted': Part(
        'ranging', 'blinks = dark > 0 &&', 'blinks = false && dark > 0 &&'
    ),
    'range: background that is apart': Part('ranging', '!(walls > 0 && is', '!(false && is'),
    'range: samples of what is apart left out': Part(
        'ranging', 'gap_m >= sensor->separable_m ? 0', 'gap_m >= INFINITY ? 0'
    ),
    'range: or a mounting': Part(
        'ranging', 'chance = rl_chance_apart(', 'chance = 1.0 + 0.0 * rl_chance_apart('
    ),
    'range: samples within the zone': Part(
        'ranging', 'seen->others > 0 ? 0.0 : IN_ZONE', 'seen->others > -1 ? 0.0 : IN_ZONE'
    ),
    'range: samples near the middle one': Part(
        'ranging', 'about_m) < seen->sensor->separable_m', 'about_m) < INFINITY'
    ),
    'range: where it was at the mean time': Part(
        'ranging', 'chance = 1.0 / (1.0', 'chance = 0.0 / (1.0'
    ),
    'range: zones at other times count less': Part(
        'placement', ' + bend_m * bend_m', ' + 0.0 * bend_m'
    ),
    'range: variance of motion': Part('placement', ' + common;', ' + 0.0 * common;'),
    'range: zones that differ': Part('placement', 'fmax(spread, 1.0)', 'fmax(0.0 * spread, 1.0)'),
    'bearing: noise that goes on': Part(
        'amplitude', '1.0 + 2.0 * fmax(alike', '1.0 + 0.0 * fmax(alike'
    ),
    'bearing: few samples tell no gain': Part(
        'amplitude', 'count >= RL_WORD_DISTANCE', 'count >= 0.0'
    ),
    'bearing: neighbours': Part(
        'bearing', '1.0 / (variance[other] + doubt * doubt)', '(other == zone) / (doubt * doubt)'
    ),
    'bearing: error of the model': Part('bearing', 'MODEL_ERROR = 0.02', 'MODEL_ERROR = 0.001'),
    'bearing: less blur is likelier': Part('bearing', '1.0 / sqrt(blur)', '1.0'),
}
"""By what they do."""

SETS = {
    'the two rival sequences': (
        'margin: other IDs one after the other',
        'margin: markers that appear or vanish',
    ),
    'both word tests': ('word test: bits turned', 'word test: bits of the search'),
    'residual and pairs': ('search of the residual', 'pairs of packets'),
    'few changes and preambles': (
        'more evidence for few changes',
        'word test: a preamble that is not known',
    ),
}
"""Parts that may cover for each other."""


def part_changes() -> dict[str, list[Part]]:
    """Return what changes the core without each part, and without each set of parts."""
    without = {name: [part] for name, part in PARTS.items()}
    return without | {name: [PARTS[part] for part in parts] for name, parts in SETS.items()}
