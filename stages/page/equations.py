r"""Typeset the LaTeX that sections use as MathML, which browsers draw without any
script.

Known: letters, digits, Greek, sub- and superscripts, primes, `\dot \ddot \bar \hat
\tilde \vec \mathbf \mathrm \text \frac \sqrt`, `\left \right`, matrices, aligned lines,
and common operators. An unknown command is shown as written, so that nothing is lost.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from html import escape

TOKEN = re.compile(r"\\[A-Za-z]+\*?|\\\\|\\.|\d+(?:\.\d+)?|\s+|.", re.DOTALL)
GREEK = {
    "alpha": "α", "beta": "β", "gamma": "γ", "delta": "δ", "epsilon": "ϵ", "varepsilon": "ε", "zeta": "ζ", "eta": "η", "theta": "θ",
    "vartheta": "ϑ", "iota": "ι", "kappa": "κ", "lambda": "λ", "mu": "μ", "nu": "ν", "xi": "ξ", "pi": "π", "rho": "ρ", "sigma": "σ",
    "tau": "τ", "upsilon": "υ", "phi": "ϕ", "varphi": "φ", "chi": "χ", "psi": "ψ", "omega": "ω", "Gamma": "Γ", "Delta": "Δ",
    "Theta": "Θ", "Lambda": "Λ", "Xi": "Ξ", "Pi": "Π", "Sigma": "Σ", "Upsilon": "Υ", "Phi": "Φ", "Psi": "Ψ", "Omega": "Ω",
}  # fmt: skip
OPERATORS = {
    "cdot": "·", "times": "×", "pm": "±", "mp": "∓", "le": "≤", "leq": "≤", "ge": "≥", "geq": "≥", "ne": "≠", "neq": "≠", "approx": "≈",
    "sim": "∼", "propto": "∝", "partial": "∂", "nabla": "∇", "int": "∫", "sum": "∑", "prod": "∏", "infty": "∞", "to": "→", "in": "∈",
    "otimes": "⊗", "odot": "⊙", "ldots": "…", "dots": "…", "cdots": "⋯", "top": "⊤", "lVert": "‖", "rVert": "‖", "Vert": "‖",
    "lvert": "|", "rvert": "|", "mid": "|", "langle": "⟨", "rangle": "⟩", "equiv": "≡", "ll": "≪", "gg": "≫", "Rightarrow": "⇒",
    "{": "{", "}": "}", "|": "‖", "%": "%", "_": "_", "&": "&", "#": "#", "$": "$",
}  # fmt: skip
FUNCTIONS = {
    "sin", "cos", "tan", "arcsin", "arccos", "arctan", "exp", "log", "ln",
    "min", "max", "det", "rank", "sign", "diag", "tr", "arg", "median",
}  # fmt: skip
ACCENTS = {
    "dot": "˙",
    "ddot": "¨",
    "bar": "¯",
    "overline": "¯",
    "hat": "ˆ",
    "tilde": "˜",
    "vec": "→",
    "widetilde": "˜",
    "widehat": "ˆ",
}
SPACES = {
    ",": "0.17em",
    ":": "0.22em",
    ";": "0.28em",
    "quad": "1em",
    "qquad": "2em",
    " ": "0.25em",
    "!": "0",
}
FONTS = {
    "mathbf": "bold",
    "boldsymbol": "bold",
    "bm": "bold",
    "mathrm": "upright",
    "text": "text",
    "operatorname": "upright",
    "mathcal": "plain",
}
ENDS = {"}", r"\right", r"\end"}


@dataclass
class _Reader:
    tokens: list[str]
    place: int = 0
    opened: list[str] = field(default_factory=list)

    def peek(self) -> str:
        return self.tokens[self.place] if self.place < len(self.tokens) else ""

    def take(self) -> str:
        token = self.peek()
        self.place += 1
        return token

    def skip_space(self) -> None:
        while self.peek().isspace():
            self.place += 1


def mathml(latex: str, *, block: bool = True) -> str:
    """MathML markup of a LaTeX formula. Every character of the source is escaped;
    malformed input never raises.
    """
    try:
        rows = _lines(_Reader(TOKEN.findall(latex)))
    except RecursionError:  # thousands of nested braces: show the source
        rows = [[f"<mtext>{escape(latex)}</mtext>"]]
    body = _table(rows, "aligned") if len(rows) > 1 or len(rows[0]) > 1 else rows[0][0]
    kind = "block" if block else "inline"
    return f'<math display="{kind}" alttext="{escape(latex)}">{body}</math>'


def _lines(reader: _Reader) -> list[list[str]]:
    rows: list[list[str]] = [[]]
    while True:
        rows[-1].append(_row(reader))
        token = reader.take()
        if token == r"\\":
            rows.append([])
        elif token in ENDS:  # a stray end: drop it and read on
            if reader.opened:
                reader.place -= 1
                return rows
        elif not token:
            return rows


def _row(reader: _Reader) -> str:
    parts: list[str] = []
    while True:
        reader.skip_space()
        token = reader.peek()
        if not token or token in ENDS or token in ("&", r"\\"):
            return f"<mrow>{''.join(parts)}</mrow>"
        parts.append(_scripted(reader))


def _scripted(reader: _Reader) -> str:
    base = "<mrow></mrow>" if reader.peek() in ("_", "^") else _atom(reader)
    below = above = ""
    while True:
        reader.skip_space()
        token = reader.peek()
        if token == "_" and not below:
            reader.take()
            below = _argument(reader)
        elif token == "^" and not above:
            reader.take()
            above = _argument(reader)
        elif token == "'" and not above:
            reader.take()
            above = "<mo>′</mo>"
        else:
            break
    if below and above:
        return f"<msubsup>{base}{below}{above}</msubsup>"
    if below:
        return f"<msub>{base}{below}</msub>"
    return f"<msup>{base}{above}</msup>" if above else base


def _argument(reader: _Reader) -> str:
    reader.skip_space()
    if reader.peek() in ("", "&", r"\\", "_", "^", *ENDS):
        return "<mrow></mrow>"
    return _atom(reader)


def _atom(reader: _Reader) -> str:
    token = reader.take()
    if token == "{":
        reader.opened.append("{")
        return _inside(reader, "}")
    if token.startswith("\\"):
        return _command(token[1:], reader)
    if token[0].isdigit():
        return f"<mn>{escape(token)}</mn>"
    if token.isalpha():
        return f"<mi>{escape(token)}</mi>"
    sign = {"-": "−", "*": "∗"}.get(token, token)
    tight = ' lspace="0" rspace="0"' if token in "|()[]" else ""
    return f'<mo stretchy="false"{tight}>{escape(sign)}</mo>'


def _inside(reader: _Reader, end: str) -> str:
    parts = []
    while True:
        parts.append(_row(reader))
        token = reader.peek()
        if not token:
            break
        reader.take()
        if token == end:
            break
    reader.opened.pop()
    return parts[0] if len(parts) == 1 else f"<mrow>{''.join(parts)}</mrow>"


def _command(name: str, reader: _Reader) -> str:
    if name in GREEK:
        return f"<mi>{GREEK[name]}</mi>"
    if name in FUNCTIONS:
        return f"<mi>{name}</mi>"
    if name in OPERATORS:
        return f'<mo stretchy="false">{escape(OPERATORS[name])}</mo>'
    if name in SPACES:
        return f'<mspace width="{SPACES[name]}"></mspace>'
    if name in ACCENTS:
        return (
            f'<mover>{_argument(reader)}<mo stretchy="false" lspace="0"'
            f' rspace="0">{ACCENTS[name]}</mo></mover>'
        )
    if name in ("frac", "tfrac", "dfrac"):
        return f"<mfrac>{_argument(reader)}{_argument(reader)}</mfrac>"
    if name == "sqrt":
        return f"<msqrt>{_argument(reader)}</msqrt>"
    if name in FONTS:
        return _font(FONTS[name], reader)
    if name == "left":
        return _fenced(reader)
    if name == "begin":
        return _environment(reader)
    return f"<mtext>\\{escape(name)}</mtext>"


def _raw_group(reader: _Reader) -> str:
    """The source text of a braced group, or of one token."""
    reader.skip_space()
    if reader.peek() != "{":
        return reader.take()
    reader.take()
    depth, words = 1, ""
    while depth and reader.peek():
        token = reader.take()
        depth += {"{": 1, "}": -1}.get(token, 0)
        words += token if depth else ""
    return words


def _font(style: str, reader: _Reader) -> str:
    words = _raw_group(reader)
    if style == "text":
        return f"<mtext>{escape(words).replace(' ', chr(160))}</mtext>"
    if style == "upright":
        return f'<mi mathvariant="normal">{escape(words)}</mi>'
    inner = "".join(_row(_Reader(TOKEN.findall(words))))
    return f'<mrow class="bold">{inner}</mrow>' if style == "bold" else inner


def _fence(token: str) -> str:
    sign = OPERATORS.get(token[1:], token[1:]) if token.startswith("\\") else token
    return "" if sign == "." else f'<mo stretchy="true" fence="true">{escape(sign)}</mo>'


def _fenced(reader: _Reader) -> str:
    opening = _fence(reader.take() or ".")
    reader.opened.append(r"\left")
    inner = _inside(reader, r"\right")
    return f"<mrow>{opening}{inner}{_fence(reader.take() or '.')}</mrow>"


def _environment(reader: _Reader) -> str:
    name = _raw_group(reader)
    reader.opened.append(name)
    rows = _lines(reader)
    reader.opened.pop()
    reader.take()
    _raw_group(reader)
    fences = {"bmatrix": "[]", "pmatrix": "()", "vmatrix": "||", "cases": "{"}.get(name, "")
    left = _fence(fences[0]) if fences else ""
    right = _fence(fences[1]) if len(fences) > 1 else ""
    return f"<mrow>{left}{_table(rows, name)}{right}</mrow>"


def _table(rows: list[list[str]], name: str) -> str:
    lines = "".join(f"<mtr>{''.join(f'<mtd>{cell}</mtd>' for cell in row)}</mtr>" for row in rows)
    return (
        "<mtable"
        f' class="{"aligned" if name.startswith("align") or name == "split" else "matrix"}">{lines}</mtable>'
    )
