"""The report: a record and its experiment in; a page, ``summary.csv``, tables, figures out."""
