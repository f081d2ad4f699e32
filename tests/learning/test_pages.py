"""The pages on JAX and PyTorch: their code runs and prints what they show."""

from pathlib import Path

import pytest
from doc_pages import follow


@pytest.mark.parametrize("library", ["jax", "torch"])
def test_the_page_runs(library: str, tmp_path: Path) -> None:
    pytest.importorskip(library, reason=f"{library} is not installed: pip install 'ordernm[{library}]'")
    follow(f"docs/howto/{library}.md", tmp_path)
