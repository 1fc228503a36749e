# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What the tests read of the documents."""

import re
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]
DOCS = ROOT / 'docs'
PAGES = [ROOT / 'README.md', *sorted(DOCS.rglob('*.md'))]


def quoted(text: str) -> list[str]:
    """Return what stands in backticks."""
    return re.findall(r'`([^`]+)`', text)


def without_blocks(page: Path) -> str:
    """Return a page without its indented blocks."""
    lines = page.read_text(encoding='utf-8').splitlines()
    return '\n'.join(line for line in lines if not line.startswith('    '))


def rows(text: str, header: str) -> Iterator[list[str]]:
    """Yield the rows of all tables whose first column has this header.

    An empty first cell is that of the row before.
    """
    for table in re.findall(rf'^\| {re.escape(header)} \|.*\n\|[-|]+\n((?:\|.*\n?)+)', text, re.M):
        first = ''
        for line in table.splitlines():
            cells = [cell.strip() for cell in line.strip('|').split('|')]
            first = cells[0] = cells[0] or first
            yield cells
