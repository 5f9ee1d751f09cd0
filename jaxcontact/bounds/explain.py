"""A certificate in words, for one configuration."""

import textwrap

import numpy as np

from .certify import Certificate
from .classes import Verdict

WIDTH = 100
"""Columns of the table."""

NEGLIGIBLE = 1e-6
"""Shares of a dependence below this part of the largest are not printed."""

_WORDS = {Verdict.YES: "yes", Verdict.NO: "no", Verdict.UNDECIDED: "too close to tell"}


def explain(certificate: Certificate) -> str:
    """The certificate of one configuration as a table with a summary an engineer can act on.

    `print(explain(certify(here, jnp.array([0.3, 0.3]))))`

    Raises:
        ValueError: for a batch of certificates; take one with `jax.tree.map(lambda x: x[i], certificates)`.
    """
    if np.ndim(certificate.holds) != 1:
        raise ValueError(
            f"explain takes one certificate, got a batch of shape {np.shape(certificate.holds)[:-1]}: "
            "pick one with jax.tree.map(lambda x: x[i], certificates)"
        )
    lines = [_friction(certificate), "", *_summary(certificate), "", _row("statement", "hypotheses", "holds", "margin")]
    lines.append("-" * len(lines[-1]))
    skipped = []
    for i, (_, title, _, why) in enumerate(certificate.statements):
        if why:
            skipped.append(f"{title}: {why}")
            continue
        hypotheses, holds = (_WORDS[Verdict(int(x[i]))] for x in (certificate.hypotheses, certificate.holds))
        lines.append(_row(title, hypotheses, holds, _number(float(certificate.margin[i]))))
    lines += [
        "",
        *_wrapped(
            "A margin is bound / friction - 1 for a friction bound: 0.25 says that all coefficients may grow by "
            "a quarter. For a rank it is the smallest singular value of the gap gradients at unit length, "
            "for solvability minus the acceleration (m/s^2) by which the constraints are missed."
        ),
    ]
    if skipped:
        lines += ["", "Not about these contacts:", *(line for text in skipped for line in _wrapped(text, "  "))]
    return "\n".join(lines)


def _friction(certificate: Certificate) -> str:
    parts = []
    for contact, mu in zip(certificate.contacts, np.asarray(certificate.mu)):
        parts.append(f"{contact.name} ({contact.kind}, {f'mu = {mu:.4g}' if contact.frictional else 'frictionless'})")
    return "\n".join(_wrapped("Contacts: " + "; ".join(parts)))


def _summary(certificate: Certificate) -> list[str]:
    """What is known of uniqueness, from the strongest statement that speaks."""
    if np.any(certificate.redundancy.dependent):
        return [
            *_wrapped("The contacts are redundant: the normal forces are not unique, whatever the friction."),
            *_dependences(certificate),
        ]
    keys = dict(zip(certificate.names, range(len(certificate.names))))
    i = keys["exact"]
    if certificate.statements[i][3]:
        return _wrapped(_sufficient(certificate, keys))
    holds, margin = Verdict(int(certificate.holds[i])), float(certificate.margin[i])
    if holds == Verdict.UNDECIDED:
        return _wrapped("The friction is at the exact threshold, within rounding: a jam cannot be excluded.")
    if holds == Verdict.NO:
        return _wrapped(
            f"Not safe: the friction is {1 / (1 + margin):.4g} times what these contacts bear. For some loads or "
            "directions of sliding the contact forces do not exist (jamming, wedging) or are not unique."
        )
    if np.isinf(margin):
        return _wrapped("Safe: no friction in these proportions makes the contact forces ambiguous.")
    return _wrapped(
        f"Safe: for every load and every direction of sliding the contact forces exist and are unique. All "
        f"coefficients could grow by the factor {1 + margin:.4g} before that ends."
    )


def _dependences(certificate: Certificate) -> list[str]:
    """One line for each redundant contact: which others it depends on."""
    names = [contact.name for contact in certificate.contacts]
    lines = []
    for i in np.flatnonzero(np.asarray(certificate.redundancy.dependent)):
        shares = np.asarray(certificate.redundancy.combination)[i]
        scale = np.abs(shares).max() if shares.size else 0.0
        terms = [f"{x:+.3g} {names[j]}" for j, x in enumerate(shares) if abs(x) > NEGLIGIBLE * scale]
        lines += _wrapped(f"{names[i]} = {' '.join(terms) or '0, its gap does not move'}", "  ")
    return lines


def _sufficient(certificate: Certificate, keys: dict[str, int]) -> str:
    rows = [i for key, i in keys.items() if key not in ("exact", "prop9a", "prop9b", "cor2")]
    unique = [i for i in rows if "exactly one" in certificate.statements[i][2] and not certificate.statements[i][3]]
    if any(int(certificate.holds[i]) == Verdict.YES for i in unique):
        return "Safe: a sufficient bound holds; the exact threshold was not looked at."
    if unique:
        return "Not known: no sufficient bound holds, and the exact threshold was not looked at."
    return "Nothing is frictional: only the ranks and the solvability of the constraints matter."


def _row(title: str, hypotheses: str, holds: str, margin: str) -> str:
    return f"{title:<32}{hypotheses:<20}{holds:<20}{margin:>12}"


def _number(x: float) -> str:
    return "-" if np.isnan(x) else "no limit" if np.isposinf(x) else f"{x:.4g}"


def _wrapped(text: str, indent: str = "") -> list[str]:
    return textwrap.wrap(text, WIDTH, initial_indent=indent, subsequent_indent=indent + "  " if indent else "")
