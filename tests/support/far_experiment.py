"""An experiment of four short cells, whose results are kept in a store."""

FAR = """\
name: far
subjects: 4
cell_size: 2
conditions: [CC3]
protocol: short
protocols: {short: {attempt_limit: 3, baseline_trials: 1}}
learners: [random, oracle]
"""
