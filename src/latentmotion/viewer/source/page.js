// What both pages carry, so that three.js is in the package once: the user study's script where the
// page holds a study, else the script that shows motions.

if (document.getElementById("study")) import("./study/main.js");
else import("./main.js");
