"""Behind the learner ``llm``: what answers mean, the server, and the replies given before."""
