"""Pictures of schemas and rooms, and films of trials.

================ ==================================================================================
``graph``        A schema as a figure or as text.
``room``         A room as pixels, text or a file, also after actions; ``svg`` for papers.
``scene``        What a picture consists of; ``raster`` makes pixels of it, ``panel`` the console.
``filmed_trial`` The trial that a film shows, played now or recorded.
``film``         A film of it, written by ``video``.
``watch``        A trial moment by moment, with what the learner believes.
================ ==================================================================================
"""
