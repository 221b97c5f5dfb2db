"""The report: a record with its experiment in; a page, ``summary.csv``, tables and figures out.

``writing`` counts the record, collects the ``sections`` (a module for each; there is how to add
one) and renders the page. A section is data (``section``) whose sentences are in
``templates/NAME.txt.j2`` (``prose``).
"""
