# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Bind the core to Python, as the module `retrolidar_ros._core`.

setup.py takes `ffi` from here. CMake runs this file with the path of the C code to write.
"""

import re
import sys
from pathlib import Path

from cffi import FFI

HEADERS = tuple(
    f'retrolidar_{name}.h'
    for name in (
        'packet_format',
        'packet',
        'sensor',
        'receive',
        'template',
        'decide',
        'bearing',
        'detector',
        'ranging',
        'pose',
        'tracks',
    )
)
"""Those that Python sees, each after those that it needs."""

CORE = Path(__file__).parent
SOURCES = CORE / 'src'


def declarations(header: str) -> str:
    """Return what a header declares between its marks, or raise ValueError if there are none."""
    text = (SOURCES / header).read_text(encoding='utf-8')
    parts = re.findall(r'^/\* binding \*/$(.*?)^/\* end of binding \*/$', text, re.M | re.S)
    if not parts:
        raise ValueError(f'{header} marks nothing to bind')
    return ''.join(parts)


ffi = FFI()
ffi.cdef(''.join(map(declarations, HEADERS)))
ffi.set_source(
    'retrolidar_ros._core',
    ''.join(f'#include "{header}"\n' for header in HEADERS),
    sources=sorted(map(str, SOURCES.glob('*.c'))),
    depends=sorted(map(str, SOURCES.glob('*.h'))),
    include_dirs=[str(SOURCES)],
    # The same arithmetic on every processor, and a quick one; NaN and infinity are as usual.
    extra_compile_args=(CORE / 'compile_flags.txt').read_text(encoding='utf-8').split(),
    libraries=['m'],
)

if __name__ == '__main__':
    ffi.emit_c_code(sys.argv[1])
