# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Parts of the core's decision: what a part does, and the line that makes it work."""

from evaluation.bench.changed_core import Part, parts_of

_LINES = {
    'earlier packets fitted along': 'window: i < {interference->count => 0}; i++',
    'earlier packets: gains that change': 'window: changes < {2 => 1};',
    'earlier packets: gains of either sign': 'window: light, {true => false})',
    'earlier packets: from their start on': 'template: {floor(before + WHOLE) => before}',
    'the next packet without a search': 'process_frame: {judge_next(detector, from_s); => ;}',
    'expected packets of any ID without a search': 'process_frame: '
    '{rl_judge_expected(detector, from_s); => ;}',
    'expected packets: no price of a start': 'decide: '
    'return {judged->is_expected ? RL_COST_OF_CHANCE : 0.0 => 0.0}',
    'expected packets: not one after two': 'pool: ended {== 1 || followed == 1 => + followed > 0}',
    'search of the residual': 'process_frame: '
    '{search_residual(detector, floor(from_s / slot_s) * slot_s); => ;}',
    'search of the residual: gains for a level that hardly wanders': 'whitened: '
    'null_walk < {RL_WANDERS => RL_WALKS} ?',
    'residual searched again once it is known': 'process_frame: '
    '{again ? anew_s : from_s => from_s}',
    'search of the residual: sums of zones, too': 'process_frame: '
    '{( => channel < samples->zones && (}zones & subtracted) != 0 && rest[channel] > RL_ACTIVE',
    'search of the residual: zones beside, too': 'pool: '
    'end_s > since_s ? {track->near => track->zones}',
    'residual searched again: zones beside, too': 'pool: '
    'read_anew |= {track->near => track->zones}',
    'pairs of packets': 'judge: may_hide && {judge_pair => false && judge_pair}(',
    'pairs of packets: others of the same sum': 'judge: '
    '? {rl_pair_margin => RL_MAX_MARGIN + 0.0 * rl_pair_margin}(',
    'pairs of packets: one of them is known': 'judge: '
    'fmin(verdict.margin, {margin => RL_MAX_MARGIN + 0.0 * margin})',
    'pairs of packets: sent together with a lone one': 'judge: '
    'if ({found.hits.count == 0 => false} && !one',
    'pairs of packets: whole ones only': 'pair: '
    'return {may_be_incomplete => false && may_be_incomplete}(',
    'pairs of packets: in the window of a lone one': 'pair: '
    '{first.begin_s = second.begin_s = lone->begin_s;\n'
    '    first.end_s = second.end_s = lone->end_s; => (void)lone;}',
    'what has appeared, from fewer bits': 'process_frame: {search_appeared(detector); => ;}',
    'what has appeared: less its first sample': 'process_frame: '
    '*since_s == INFINITY ? {detector->newest_s '
    '=> detector->samples.begin_s[detector->samples.count - 1]} :',
    'what has appeared: energy of bits seen': 'hits: {trial->seen => RL_ALL_BITS}, entry->shift',
    'what has appeared: bits in order of time': 'codebook: '
    '{rl_rotate_bits(packet, first) & seen '
    '=> packet & rl_rotate_bits(seen, RL_PACKET_BITS - first)}',
    'what has appeared: all starts kept': 'hits: RL_ALL_BITS ? {RL_PACKET_BITS => RL_HITS}',
    'what has appeared: with each bit': 'process_frame: '
    'comes({bit_s => 2.0 * bit_s}, from_s, to_s)',
    'the last packet with every other bit': 'process_frame: STRETCH_BITS = {2 => RL_LOOK_BITS}',
    'lone packets': 'process_frame: '
    '{search(detector, channels, count, 0, from_s, -INFINITY); => ;}',
    'several packets combined': 'process_frame: round < {rounds => 1} &&',
    'sums of zones': 'process_frame: {( => zones == 1 && (}that_vary ?',
    'sums of zones: erased by zones that vary': 'samples: {2.0 => 0.0} * variance <',
    'sums of more than 2x2 zones': 'process_frame: {( => zones <= 4 && (}that_vary ?',
    'word test: bits turned': 'bits: if ({gained > better => false}) {',
    'word test: bits of the search': 'bits: i < {judged->hits->sequences => 0} &&',
    'margin to other IDs': 'decide: if ({verdict->margin < judged->thresholds->margin => false}) {',
    'margin: less what other bits explain, among others': 'decide: '
    '? {fmax(judged->verdict.word, 0.0) => 0.0}',
    'margin and word test: a price of a start among others': 'decide: '
    '{is_among_others(judged) && !judged->is_expected => false}',
    'margin: lone packets against others that repeat': 'rivals: '
    '{find_rival '
    '=> if (judged->verdict.transmission.repeats) find_rival}(judged, begin, true, &rivals);',
    'margin: other IDs one after the other': 'decide: '
    '{margin = fmin => fmin}(margin, rl_rivals_successive_margin(',
    'margin: markers that appear or vanish': 'decide: '
    '{margin = fmin => fmin}(margin, rl_rivals_part_margin(',
    'margin: the next packet of a known marker': 'rivals: '
    '{fmax(nearest, rl_rivals_next(judged)) => nearest}',
    'zone by zone: judged again': 'judge: .zones != {RL_SUMMED => 0}) {',
    'gains that change along the packet': 'decide: '
    '{verdict->packets == 1 => false} ? rl_window_follow_gain',
    'word test: expected packets': 'decide: word {+ saved_start(judged) - => -}',
    'word test: bits that are not known': 'decide: {fmax(unknown, 0.0) => 0.0 * unknown}',
    'word test: two packets together': 'decide: {judged->word_before => 0.0};',
    'word test: unknown bits of what appeared': 'decide: return {2.0 * log => log}(2.0);',
    'word test: a preamble that is not known': 'decide: '
    '{2.0 * preamble > RL_PREAMBLE_BITS => false && preamble > 0.0}',
    'bits that touch a packet': 'observation: '
    '{!transmission->repeats => false} && find_neighbours(',
    'other clocks': 'decide: {other > judged->thresholds->word => false} ?',
    'readings keep time with packets': 'pool: '
    'until_s = {packets_end_s < verdict->end_s + => 1.0 < 0.0 *}',
    'a packet that repeats has repeated': 'decide: {! => false && !}has_repeated(',
    'a packet that repeats is no lone one': 'decide: '
    '&& {may_be_lone => false && may_be_lone}(judged)',
    'stretches judged as lone packets, too': 'judge: '
    '{verdict.reason => true || verdict.reason} != RL_INCOMPLETE ||',
    'more evidence for few changes': 'decide: cost = {2.0 => 0.0} * RL_COST_OF_CHANCE',
    'more evidence where levels wander': 'decide: {judged->thresholds->wandering => 0.0} : 0.0',
    'search: three ways to follow the level': 'search: {0.01f, {0.1f, 0.002f => 0.01f, 0.01f}}',
    'two targets of a zone told apart': 'target: '
    '{samples->interference_removed => true || samples->interference_removed}[channel] ||',
    'two targets: the marker may be the dimmer one': 'observation: '
    'if ({judged->window->column.has_two_targets => false} &&',
    'zones: those near the reading only': 'placement: '
    'if ({is_near(samples, reading, zone) => true})',
    'zones: light that is not known': 'placement: {ALIKE * amplitude->unknown[zone] => 0.0}',
    'zones: by samples of dark bits': 'blinking: {dark > 2.0 => false} ?',
    'range: unsure where no zone surely sees the packet': 'placement: {is_seen => true} ? 0.0',
    'range: mean of all zones': 'placement: i < {placement->zones => 1}; i++',
    'range: other markers fitted along': 'placement: seen->others < {RL_MAX_OTHERS => 0};',
    'range: other markers beside, too': 'placement: {track->near => track->zones} >> zone & 1u',
    'range: background subtracted': 'ranging: blinks = {dark => false && dark} > 0 &&',
    'range: background that is apart': 'ranging: !({walls > 0 => false} && is',
    'range: samples of what is apart left out': 'ranging: '
    'gap_m >= {sensor->separable_m => INFINITY} ? 0',
    'range: or a mounting': 'ranging: chance = {rl_chance_apart => 1.0 + 0.0 * rl_chance_apart}(',
    'range: samples within the zone': 'ranging: seen->others > {0 => -1} ? 0.0 : IN_ZONE',
    'range: samples near the middle one': 'ranging: '
    'about_m) < {seen->sensor->separable_m => INFINITY}',
    'range: where it was at the mean time': 'ranging: chance = {1.0 => 0.0} / (1.0',
    'range: zones at other times count less': 'placement: + {bend_m => 0.0} * bend_m',
    'range: variance of motion': 'placement: + {common => 0.0 * common};',
    'range: zones that differ': 'placement: fmax({spread => 0.0 * spread}, 1.0)',
    'bearing: noise that goes on': 'blinking: 1.0 + {2.0 => 0.0} * fmax(alike',
    'bearing: few samples tell no gain': 'blinking: count >= {RL_WORD_DISTANCE => 0.0}',
    'bearing: neighbours': 'bearing: '
    '{1.0 / (variance[other] + doubt => (other == zone) / (doubt} * doubt)',
    'bearing: error of the model': 'bearing: MODEL_ERROR = {0.02 => 0.001}',
    'bearing: less blur is likelier': 'bearing: {1.0 / sqrt(blur) => 1.0}',
}
PARTS = parts_of(_LINES)
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
    without = {name: [one] for name, one in PARTS.items()}
    return without | {name: [PARTS[one] for one in names] for name, names in SETS.items()}
