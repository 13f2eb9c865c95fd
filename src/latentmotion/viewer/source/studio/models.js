// The model that makes the next takes: chosen in Settings, loaded by the server meanwhile.

import { send } from "./api.js";
import { fill, find, onChange, say, trying } from "./dom.js";

export class Models {
  /** `offered` are the models of the server. */
  constructor(studio, offered) {
    Object.assign(this, { studio });
    studio.models = new Map(offered.map((model) => [model.name, model]));
    this.loaded = new Set(offered.filter(({ loaded }) => loaded).map(({ name }) => name));
    fill(find("model"), [...studio.models.keys()], studio.capabilities.model);
    onChange("model", ({ value }) => this.choose(value));
    studio.addEventListener("draft", () => trying(() => this.follow()));
    this.#show();
  }

  /** Makes the next takes with a model, in its usual way. */
  choose(name) {
    const { guidance, prompts, usual_steps: steps } = this.studio.models.get(name).capabilities;
    return this.studio.change("Model", ({ segments, settings }) => {
      Object.assign(settings, { model: name, steps, guidance: guidance.usual });
      if (prompts === "nothing") segments.forEach((segment) => (segment.prompt = ""));
    });
  }

  /** Offers what the draft's model can do, and has it loaded. */
  async follow() {
    const { studio } = this;
    const { model } = studio.draft.settings;
    if (model === studio.capabilities.model) return;
    studio.capabilities = studio.models.get(model).capabilities;
    studio.tell("capabilities");
    this.#show();
    if (this.loaded.has(model)) return;
    say(`Loading the model ${model} …`);
    await send("POST", "models", { model });
    // Another one has left the server's memory for it.
    this.loaded = new Set([studio.models.keys().next().value, model]);
    this.#show();
    if (model === studio.capabilities.model) say(`The model ${model} makes the next takes.`);
  }

  #show() {
    const { model, license } = this.studio.capabilities;
    find("model").value = model;
    find("model-about").textContent = `${license}${this.loaded.has(model) ? "" : "; it is being loaded"}`;
  }
}
