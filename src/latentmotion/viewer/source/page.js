// What all pages carry, so that three.js is in the package once: the user study's script where the
// page holds a study, that of the site where it has a prompt, else the script that shows motions.
// The studio has a script of its own, which takes three.js and the mannequin from here.
import mannequin from "../../render/mannequin.json";
import * as three from "./three.js";

if (document.getElementById("screens")) Object.assign(globalThis, { three, mannequin });
else if (document.getElementById("study")) import("./study/main.js");
else if (document.getElementById("make")) import("./site/main.js");
else import("./main.js");
