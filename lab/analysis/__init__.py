"""Analysis: functions of a run: errors, NEES and NIS, verdict, error budget, observability, Allan deviation.

In: a `Run`, or plain arrays. Out: numbers and sentences. `verdicts` says what is wrong with a filter,
`identification` estimates its noise.

Read first: `errors` (error is estimate minus truth), `consistency` (NEES, NIS, whiteness),
`verdicts.verdict`.
"""
