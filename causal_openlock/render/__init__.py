"""Pictures of schemas and rooms, and films of trials.

================ ==================================================================================
``graph``        A schema as a figure or as text.
``scene``        What a picture of a room consists of; ``paint`` makes pixels or SVG of it.
``room``         A room after actions, as a file or as text; ``words``: what people see, in words.
``film``         A film of a trial, played now or recorded, as a GIF or MP4.
``watch``        A trial moment by moment, with what the learner believes.
================ ==================================================================================
"""
