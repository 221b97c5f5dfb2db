"""Plans of fits with other settings."""

from dataclasses import replace
from typing import Any

from causal_openlock.fitting.plan import Plan


def with_settings(plan: Plan, **settings: Any) -> Plan:
    """A plan with other settings."""
    return replace(plan, fit=plan.fit.model_copy(update=settings))
