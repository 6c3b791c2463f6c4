"use strict";
for (const table of document.querySelectorAll("table.index")) {
  const body = table.tBodies[0];
  const heads = [...table.tHead.rows[0].cells];
  const numeric = (column) => [...body.rows].every((row) => !isNaN(Number(row.cells[column].dataset.key)));
  const order = (column, sign) => {
    const number = numeric(column);
    const key = (row) => row.cells[column].dataset.key;
    const compare = (a, b) => {
      // What is not known comes last, whichever way.
      if (key(a) === "" || key(b) === "") return (key(a) === "") - (key(b) === "");
      return sign * (number ? Number(key(a)) - Number(key(b)) : key(a).localeCompare(key(b)));
    };
    body.append(...[...body.rows].sort(compare));
  };
  heads.forEach((head, column) => {
    const button = document.createElement("button");
    button.type = "button";
    button.textContent = head.textContent;
    head.replaceChildren(button);
    button.addEventListener("click", () => {
      const up = head.getAttribute("aria-sort") !== "ascending";
      heads.forEach((other) => other.removeAttribute("aria-sort"));
      head.setAttribute("aria-sort", up ? "ascending" : "descending");
      order(column, up ? 1 : -1);
    });
  });
}
