# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The core with some lines of its source changed before it is compiled.

So the core itself has no switches.
"""

import re
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from hashlib import sha256
from importlib.util import module_from_spec, spec_from_file_location
from multiprocessing import get_context
from pathlib import Path
from tempfile import gettempdir, mkdtemp
from typing import Any, NamedTuple

from cffi import FFI

_ROOT = Path(__file__).resolve().parents[2]
_MODULE = 'retrolidar_ros._core'
_OBJECTS = Path(gettempdir()) / 'retrolidar_core_objects'
_CHANGE = re.compile(r'\{([^{]*?) => (.*?)\}', re.DOTALL)


class Part(NamedTuple):
    """A line of the core, such as makes a part work, and what stands there without the part."""

    file: str
    line: str
    without: str

    @property
    def source(self) -> str:
        """The name of its file in core/src: of a header it has a suffix, of C code none."""
        return f'retrolidar_{self.file}' + ('' if '.' in self.file else '.c')


def parts_of(table: Mapping[str, str]) -> dict[str, Part]:
    """Return parts of entries `file: line`, in which `{what works => what stands there then}`."""
    found = {}
    for name, entry in table.items():
        file, line = entry.split(': ', 1)
        found[name] = Part(file, *(_CHANGE.sub(side, line) for side in (r'\1', r'\2')))
    return found


def check_changes(changes: Mapping[str, Sequence[Part]]) -> None:
    """Raise ValueError with the names of changes whose lines the core does not have just once."""
    texts = {path.name: path.read_text(encoding='utf-8') for path in core_sources()}
    gone = [
        name
        for name, parts in changes.items()
        if any(texts.get(part.source, '').count(part.line) != 1 for part in parts)
    ]
    if gone:
        raise ValueError(f'the core has no such line, or several: {"; ".join(gone)}')


def call_with(changes: Sequence[Part], function: Callable[..., Any], *arguments: Any) -> Any:
    """Return what a function returns by a core with some lines changed.

    It is called in a new process, as a process keeps its first core.
    """
    spawn = get_context('spawn')
    with ProcessPoolExecutor(1, spawn, use_core_with, (changes,)) as pool:
        return pool.submit(function, *arguments).result()


def use_core_with(changes: Sequence[Part]) -> None:
    """Compile the core with some lines changed, and make this process use it.

    Raises ValueError if the core has a line not once, RuntimeError if it is imported already.
    """
    if _MODULE in sys.modules:
        raise RuntimeError('a core has been imported already')
    check_changes({part.line: [part] for part in changes})
    folder = Path(mkdtemp(prefix='changed_core_'))
    sources = {path.name: path.read_text(encoding='utf-8') for path in core_sources()}
    for part in changes:
        sources[part.source] = sources[part.source].replace(part.line, part.without)
    for file, text in sources.items():
        (folder / file).write_text(text, encoding='utf-8')
    sys.path.insert(0, str(_ROOT / 'core'))
    import binding

    sys.path.pop(0)
    ffi = FFI()
    ffi.cdef(''.join(map(binding.declarations, binding.HEADERS)))
    ffi.set_source(
        '_core',
        ''.join(f'#include "{header}"\n' for header in binding.HEADERS),
        include_dirs=[str(folder)],
        extra_objects=_objects(folder, sources),
        extra_compile_args=['-fvisibility=hidden'],
        extra_link_args=['-Wl,--gc-sections'],
        libraries=['m'],
    )
    spec = spec_from_file_location('_core', ffi.compile(tmpdir=str(folder)))
    assert spec is not None
    assert spec.loader is not None
    sys.modules[_MODULE] = module_from_spec(spec)
    spec.loader.exec_module(sys.modules[_MODULE])


def _objects(folder: Path, sources: dict[str, str]) -> list[str]:
    """Compile the sources in a folder, but for those that were compiled before; return objects."""
    flags = (_ROOT / 'core/compile_flags.txt').read_text(encoding='utf-8').split()
    # What nothing calls any longer is left out, so that lines of code tell what a part takes.
    flags += ['-g', '-fPIC', '-ffunction-sections', '-fvisibility=hidden']
    headers = ''.join(text for file, text in sources.items() if file.endswith('.h'))
    _OBJECTS.mkdir(exist_ok=True)
    objects = []
    for file in (file for file in sources if file.endswith('.c')):
        content = '\0'.join([*flags, headers, file, sources[file]])
        kept = _OBJECTS / f'{sha256(content.encode()).hexdigest()}.o'
        if not kept.exists():
            made = folder / f'{file}.o'
            command = ['cc', *flags, '-c', str(folder / file), '-o', str(made)]
            subprocess.run(command, check=True)
            made.replace(kept)
        objects.append(str(kept))
    return objects


def lines_of_core() -> int:
    """Return how many lines of the core that `use_core_with` compiled have become code."""
    command = ['objdump', '--dwarf=decodedline', str(sys.modules[_MODULE].__file__)]
    text = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout
    return len(set(re.findall(r'^(retrolidar_\w+\.c) +(\d+) ', text, re.MULTILINE)))


def core_sources() -> list[Path]:
    """Return the C files and headers of the core."""
    return sorted((_ROOT / 'core/src').glob('retrolidar_*.[ch]'))
