"""Both printed pairs regenerated and judged; the main report."""
