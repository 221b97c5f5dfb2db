"""Results folders: what is stored of an experiment, checked whenever it is read.

=============== ===================================================================================
``store``       A results folder: its experiment, and the records of the cells that are done.
``beside_cell`` What stands beside the record of a cell: its checkpoint, and why it failed.
``versions``    The versions of packages that results were made with.
``folder_lock`` One process at a time works in a folder, or one for each shard of its cells.
=============== ===================================================================================
"""
