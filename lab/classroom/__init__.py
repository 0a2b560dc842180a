"""Classroom: lessons, exercises, the break-it gallery and homework, with the check of a student's own result.

In: TOML files of a teacher, notebooks, and the runs of a student. Out: texts, questions, hints and grades.

Read first: `lessons.lesson` (what a lesson is), `lessons.check` (how a result is judged), `homework.homework`
(hidden settings and grades).
"""
