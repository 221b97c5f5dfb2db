"""Results folders: what is stored of an experiment, checked whenever it is read.

================= =================================================================================
``store``         A results folder: its experiment, and the cells that are done.
``stored``        ``experiment.json``, read into typed objects.
``cell_file``     The file of a cell: its record, with its identity and versions of packages.
``running_files`` The files next to a cell while it is played.
``failures``      Why cells failed.
``versions``      The versions of packages that results were made with.
``folder_lock``   One process at a time works in a folder, or one for each shard.
``shard``         A fixed share of the cells, for a job array.
================= =================================================================================
"""
