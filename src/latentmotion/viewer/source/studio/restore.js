// The work of this browser: kept at every change, and there again after a reload or a restart.

import { get } from "./api.js";
import { draftOfProject, emptyDraft, projectOf } from "./draft.js";
import { find, onClick } from "./dom.js";

const NAME = "work"; // of what a project would hold

/** Keeps draft, takes and figure from now on; the tab's own come before those of other tabs. */
export function keepWork(studio, { strip }) {
  const key = keyOf(studio);
  const keep = () => {
    const draft = structuredClone(studio.draft);
    draft.segments[strip.chosen].prompt = find("prompt").value; // also while it is written
    const { picked, figure } = studio;
    const work = JSON.stringify({ ...projectOf(NAME, draft, studio.takes), picked, figure });
    for (const storage of [sessionStorage, localStorage]) storage.setItem(key, work);
  };
  for (const change of ["draft", "takes", "pick", "staged"]) studio.addEventListener(change, keep);
  find("prompt").addEventListener("input", keep);
  onClick("start-anew", () => studio.startAnew());
}

/** Brings back what was kept; says so where there is something. */
export async function restoreWork(studio) {
  const key = keyOf(studio);
  const text = sessionStorage.getItem(key) ?? localStorage.getItem(key);
  if (!text) return;
  const { picked, figure, ...work } = JSON.parse(text);
  const takes = await Promise.all(work.takes.map((id) => get(`takes/${id}`).catch(() => null)));
  const there = takes.filter((take) => take && !take.missing && !take.deleted);
  const draft = draftOfProject(work, emptyDraft(studio.capabilities));
  const isEmpty = !there.length && draft.segments.length === 1 && !draft.segments[0].prompt;
  if (isEmpty) return;
  if (find("figure").querySelector(`option[value="${CSS.escape(figure)}"]`)) studio.figure = find("figure").value = figure;
  studio.draft = studio.withModel(draft, ({ name }) => name === draft.settings.model);
  studio.tell("draft");
  await studio.show(there, picked);
  find("restored").hidden = false;
  for (const change of ["takes", "edited"]) {
    studio.addEventListener(change, () => (find("restored").hidden = true), { once: true });
  }
}

const keyOf = ({ capabilities: { library } }) => `latentmotion-studio ${library}`;
