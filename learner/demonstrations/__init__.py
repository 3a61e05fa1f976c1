"""Recorded games with which a run's replay begins.

They are sent as an actor named `DEMONSTRATIONS` would send them: as ordinary chunks in ordinary
requests, which are checked and counted like any other. So it does not matter whether the replay
is in this process or in one of its own.

Their steps are steps of the run: they shorten the warm-up, ε falls as if they had been played now,
and the limiter holds actors back until the learner has made the updates that they call for. Their
games are not counted, because the scores of a run are those of its own play.

A recording always yields the same chunks, down to the incarnation of their sender. So the replay
recognises those that it has, and an interrupted start can be repeated without harm.
"""
