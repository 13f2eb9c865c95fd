// Projects: the draft and the takes on the stage under a name, one JSON file each.

import { get, request, send } from "./api.js";
import { draftOfProject, emptyDraft, projectOf } from "./draft.js";
import { find, make, onClick, say, trying } from "./dom.js";

export class Projects {
  constructor(studio) {
    this.studio = studio;
    onClick("open-projects", () => this.show());
    find("save-project").addEventListener("submit", (event) => {
      event.preventDefault();
      trying(() => this.save());
    });
  }

  async show() {
    find("projects").showModal();
    find("project-name").focus();
    await this.#list();
  }

  async #names() {
    return (await get("projects")).projects.map(({ name }) => name);
  }

  async #list() {
    const rows = (await this.#names()).map((name) => {
      const open = { type: "button", textContent: name, aria: { label: `Open ${name}` } };
      const remove = { type: "button", textContent: "Delete", aria: { label: `Delete ${name}` } };
      return make("li", {},
        make("button", { ...open, on: { click: () => trying(() => this.open(name)) } }),
        make("button", { ...remove, on: { click: () => trying(() => this.remove(name)) } }),
      );
    });
    find("project-list").replaceChildren(...rows);
  }

  /** Saves under the name of the field; a project of that name is replaced, which can be undone. */
  async save() {
    const name = find("project-name").value.trim();
    if (!name) {
      find("project-name").focus();
      throw new Error("Give the project a name.");
    }
    const content = projectOf(name, this.studio.draft, this.studio.takes);
    await this.#replace("Save project", name, content);
    find("projects").close();
    say(`Saved the project ${name}.`);
  }

  async remove(name) {
    await this.#replace("Delete project", name, null);
    say(`Deleted the project ${name}. Ctrl+Z brings it back.`);
  }

  async #replace(action, name, content) {
    const path = `projects/${encodeURIComponent(name)}`;
    const before = (await this.#names()).includes(name) ? await get(path) : null;
    const put = (project) => async () => {
      if (project) await send("PUT", path, project);
      else await request("DELETE", path);
      await this.#list();
    };
    await this.studio.history.act(action, put(content), put(before));
  }

  async open(name) {
    find("projects").close(); // what goes wrong is told behind it
    const project = await get(`projects/${encodeURIComponent(name)}`);
    const takes = await Promise.all(project.takes.map((id) => get(`takes/${id}`).catch(() => null)));
    const there = takes.filter((take) => take && !take.missing);
    const { studio } = this;
    const drafted = draftOfProject(project, emptyDraft(studio.capabilities));
    const opened = studio.withModel(drafted, ({ name }) => name === drafted.settings.model);
    await studio.replace("Open project", opened, there);
    find("project-name").value = name;
    const lost = takes.length - there.length;
    say(`Opened ${name}${lost ? `; ${lost} of its takes are missing` : ""}.`, lost > 0);
  }
}
