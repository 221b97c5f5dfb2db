"""The report: a record with its experiment in; a page, ``summary.csv``, tables and figures out.

``writing`` counts the record, collects the sections and renders the page.

=================== =============================================================================
``writing``         The report itself: ``write_report``.
``section``         What an analysis hands over: text, tables and plots, as data.
``sections``        A module for each section, in reading order; how to add one.
``prose``           The sentences: ``templates/NAME.txt.j2``, filled in with what was found.
``what_was_run``    The experiment in words.
``missing``         Cells that are not there, and why.
``cautions``        What a reader should know before believing the numbers.
``learner_pages``   A part of the page for each learner.
``table_files``     Tables as HTML, CSV and LaTeX.
``page``            Figures and tables as files, and within the page (``templates/*.html.j2``).
``difference_page`` Two results side by side.
=================== =============================================================================
"""
