// Elements made from code. Text is always text: nothing that comes from a log is read as HTML.
function make(tag, attributes = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (value === false || value === null || value === undefined) continue;
    element.setAttribute(name, value === true ? "" : value);
  }
  element.append(...children.filter((child) => child !== null));
  return element;
}

function makeSvg(tag, attributes = {}, text = null) {
  const element = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  if (text !== null) element.textContent = text;
  return element;
}

// [name, text] pairs into a <dl>; pairs without a text are left out.
function fillFacts(list, pairs) {
  list.replaceChildren(...pairs.filter(([, text]) => text !== null && text !== undefined)
    .flatMap(([name, text]) => [make("dt", {}, name), make("dd", {}, text)]));
}

const metres = (value) => (value < 0.1 ? `${(1000 * value).toFixed(value < 0.01 ? 1 : 0)} mm` : `${value.toFixed(2)} m`);
