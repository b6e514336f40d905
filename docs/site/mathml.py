"""Equations as MathML, which browsers draw by themselves: no script, no network, no LaTeX on the machine that builds."""

from __future__ import annotations

from typing import Any

from docutils import nodes
from latex2mathml.converter import convert


def drawn(text: str, display: str = "inline") -> str:
    """Return an equation in LaTeX as MathML; bold letters by style, because browsers no longer read ``mathvariant``."""
    for name in ("aligned", "split"):
        text = text.replace(f"\\begin{{{name}}}", "\\begin{align*}").replace(f"\\end{{{name}}}", "\\end{align*}")
    page = str(convert(text, display=display))
    return page.replace('mathvariant="bold"', 'style="font-weight:bold;font-style:normal"').replace(
        'mathvariant="bold-italic"', 'style="font-weight:bold"'
    )


def inline(self: Any, node: nodes.math) -> None:
    """Write an equation in a line."""
    self.body.append(f'<span class="equation">{drawn(node.astext())}</span>')
    raise nodes.SkipNode


def block(self: Any, node: nodes.math_block) -> None:
    """Write an equation on lines of its own."""
    self.body.append(f'<div class="equation" style="overflow-x:auto;padding:0.3em">{drawn(node.astext(), "block")}</div>')
    raise nodes.SkipNode


def setup(app: Any) -> dict[str, bool]:
    """Make it known to Sphinx."""
    app.add_html_math_renderer("mathml", inline_renderers=(inline, None), block_renderers=(block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
