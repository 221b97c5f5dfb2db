"""Plans of fits with other settings."""

from typing import Any

from causal_openlock.fitting.space import Plan


def with_settings(plan: Plan, **settings: Any) -> Plan:
    """A plan with other settings."""
    return Plan(plan.space, plan.fit.model_copy(update=settings))
