"""Evidence: this project's laboratory notebook, which is no part of its package.

A folder next to this file is a study. Its ``study.yaml`` (:mod:`evidence.study`) names an
experiment, the claims that it is to decide, and for each claim what is compared and the smallest
difference that matters. Running it (:mod:`evidence.run`) writes ``units.parquet``, a row for each
thing that was drawn independently: a subject, or a trained network (:mod:`evidence.units`).
Verdicts follow from these by stated rules (:mod:`evidence.verdicts`), and pages take their numbers
from there (:mod:`evidence.pages`).
"""
