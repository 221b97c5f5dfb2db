"""Evidence: what was run for a claim, what was measured, and what follows from it by rule.

A folder of ``evidence/`` is a study. Its ``study.yaml`` (:mod:`~causal_openlock.evidence.study`)
names an experiment file, the claims that it is to decide, and for each claim what is compared and
the smallest difference that matters. Running it (:mod:`~causal_openlock.evidence.running`) writes
``units.parquet``, a row for each thing that was drawn independently
(:mod:`~causal_openlock.evidence.units`): a subject, or a trained network. Verdicts follow from
these by stated rules (:mod:`~causal_openlock.evidence.verdicts`), and pages take their numbers from
there (:mod:`~causal_openlock.evidence.pages`).
"""
