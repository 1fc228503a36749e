# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The words of the extended Golay code by another library, komm.

All extended Golay codes are one code up to the order of the bits. In this order komm's code has the
parity bits of a bordered double circulant.

Run: python test/vectors/make_golay.py > test/vectors/golay.txt
"""

import komm  # type: ignore[import-untyped]
import numpy as np

ORDER = (0, 1, 2, 3, 4, 6, 7, 20, 21, 5, 8, 10, 15, 13, 22, 9, 17, 23, 11, 18, 14, 12, 16, 19)
CIRCULANT = (0, 2, 6, 7, 8, 10)
IDS = np.arange(4096)


def main() -> None:
    """Print the vectors."""
    # The generator [I | B], shape (12, 24): B a circulant, then a border of ones.
    generator = np.eye(12, 24, dtype=np.int64)
    for row in range(11):
        generator[row, [12 + (place - row) % 11 for place in CIRCULANT]] = generator[row, 23] = 1
    generator[11] = np.arange(24) >= 11
    generator[11, 23] = 0
    code = komm.GolayCode(extended=True)
    bits = IDS[:, None] >> np.arange(11, -1, -1) & 1
    words = np.asarray(code.encode(bits))[:, ORDER]
    ids = words[:, :12] @ (1 << np.arange(11, -1, -1))
    assert np.array_equal(words, words[:, :12] @ generator % 2)
    assert np.array_equal(np.sort(ids), IDS)
    print('# Extended Golay words, most significant bit first: ID, word in hexadecimal.')
    print(f'# komm {komm.__version__}, its bits taken in the order {" ".join(map(str, ORDER))}')
    for marker_id, word in sorted(zip(ids, words @ (1 << np.arange(23, -1, -1)), strict=True)):
        print(f'{marker_id} {word:06x}')


if __name__ == '__main__':
    main()
