"use strict";
// Plots: each draws the specification that stands in it. "ast" keeps the library from compiling text to code.
for (const plot of document.querySelectorAll(".plot")) {
  const specification = JSON.parse(plot.querySelector("script").textContent);
  specification.config.legend.columns = Math.max(1, Math.floor(plot.clientWidth / 240));
  vegaEmbed(plot, specification, { renderer: "svg", ast: true, actions: { export: true, source: false, compiled: false, editor: false } })
    .then(() => { plot.dataset.drawn = "yes"; }, (error) => { console.error(error); plot.textContent = "This plot cannot be drawn: " + error.message; });
}

// Tables: a heading sorts by its column, choices and search hide rows. Cells that hold nothing stay at the end.
for (const grid of document.querySelectorAll(".grid")) {
  const body = grid.querySelector("tbody"), rows = [...body.rows], heads = [...grid.querySelectorAll("th")];
  const choices = [...grid.querySelectorAll("select")], search = grid.querySelector("input"), said = grid.querySelector("output");
  const key = (row, column) => {
    const text = row.cells[column].textContent, number = parseFloat(text);
    return /^[-+]?[.\d]/.test(text) && !Number.isNaN(number) ? number : text;
  };
  const empty = (value) => value === "" || value === "–" || value === "nan";
  const compare = (a, b) => typeof a === "number" && typeof b === "number" ? a - b
    : typeof a === typeof b ? String(a).localeCompare(String(b)) : typeof a === "number" ? -1 : 1;
  heads.forEach((head, column) => head.querySelector("button").addEventListener("click", () => {
    const falling = head.getAttribute("aria-sort") === "ascending";
    heads.forEach((other) => other.removeAttribute("aria-sort"));
    head.setAttribute("aria-sort", falling ? "descending" : "ascending");
    rows.sort((one, other) => {
      const a = key(one, column), b = key(other, column);
      return empty(a) - empty(b) || (falling ? -1 : 1) * compare(a, b);
    });
    body.append(...rows);
  }));
  const filter = () => {
    const sought = search ? search.value.toLowerCase() : "";
    let shown = 0;
    for (const row of rows) {
      row.hidden = choices.some((choice) => choice.value && row.cells[choice.dataset.column].textContent !== choice.value)
        || !row.textContent.toLowerCase().includes(sought);
      shown += !row.hidden;
    }
    said.textContent = shown + " of " + rows.length + " rows";
  };
  for (const input of [...choices, search]) if (input) input.addEventListener("input", filter);
  filter();
}

document.getElementById("colours").addEventListener("click", () => {
  const style = document.documentElement.style;
  const dark = style.colorScheme ? style.colorScheme === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
  style.colorScheme = dark ? "light" : "dark";
});
