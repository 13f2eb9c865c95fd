"""Acts by eye: what the captions name, prompts in users' words, sheets for a judge, verdicts.

`acts.tsv` lists acts that captions of the training split name, with the expression that finds
them, clips, seconds and five prompts each; `known.tsv` has prompts of acts with many clips,
`foreign.tsv` prompts of what no caption names, `typos.tsv` prompts with one wrong letter. All were
written before the trainings and rules that they examine, by somebody who took no part in those.
"""
