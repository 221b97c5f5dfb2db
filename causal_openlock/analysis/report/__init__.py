"""The report: all that a record holds, on one page and as files.

=================== =============================================================================
``reading``         Reads a record as far as a report needs it.
``counting``        Counts its trials and categories, a few cells at a time.
``what_was_run``    What was run, in words.
``cautions``        What a reader should know before believing the numbers.
``section``         What an analysis hands over: words, tables and drawings, as data.
``sections``        Which analyses there are, in reading order.
``belief_traces``   One of them: what a learner believed in a trial, played again.
``per_learner``     A part of the page for each learner.
``table_files``     Tables as HTML, CSV and LaTeX.
``page``            Templates, figures within the page, numbers as text.
``writing``         The report itself: ``write_report``.
``differences``     How two results differ, and whether that is more than noise.
``difference_page`` The same as a page.
=================== =============================================================================
"""
