"""The signs that an English text speaks to a machine that reads: what it says, to whom, and in what frame.

A pattern is written in small letters. A name in capitals stands for a table of alternatives, "…" for anything up to
the end of the clause. One sign of weight 2 is enough; weaker ones add up.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cached_property

ENOUGH = 2

TABLES: dict[str, str] = {
    # To set aside what one was told.
    "DROP": "ignor(?:e|es|ing)|disregard(?:s|ing)?|forget(?:ting)?(?: about)?|overrid(?:e|es)|overrul(?:e|es|ing)"
    "|bypass(?:es|ing)?|circumvent(?:ing)?|neglect(?:ing)?|discard|abandon|dismiss|set aside|put aside"
    "|cast aside"
    "|throw (?:out|away)|(?:pay no|(?:do not|don't|never) pay (?:any )?) ?(?:attention|heed) to|take no "
    "notice of|cancel|revoke|scrap|suspend|break"
    "|violate|disobey|flout|defy|breach|delete|erase"
    "|(?:stop|quit|cease) (?:following|obeying|applying|respecting|heeding|trusting|using|caring about)"
    "|(?:do not|don't|never|no longer|need not|must not|shall not|should not|refuse to)"
    " (?:follow|obey|apply|respect|heed|observe|comply with|adhere to|listen to|trust|care about)",
    "DET": "all|any|every|each|both|of|the|those|these|that|this|your|you|their|his|my|our|its|whatever|more"
    "|single",
    "WHOLE": "all|any|every|each|previous|prior|earlier|preceding|above|former|foregoing|original|initial|existing"
    "|old|other|your|past|those|these|given|aforementioned|hitherto|remaining|entire",
    "FRAME": "(?:system |developer |hidden )?(?:instructions?|prompts?|messages from the system)|system messages?"
    "|directives?|guidelines?|guardrails?|safeguards?|orders|commandments?|programming"
    "|safety (?:rules?|polic(?:y|ies)|protocols?|instructions?|constraints?|guidelines?|regulations?)",
    "MATTER": "rules?|constraints?|messages?|limits?|limitations?|restrictions?|checks?|checking|notes?|records?"
    "|memor(?:y|ies)|hints?|lessons?|conversations?|context|requests?|commands?|polic(?:y|ies)|protocols?"
    "|verdicts?|verifications?|objectives?|goals?|tasks?|warnings",
    # What belongs to the reader's own frame, not to the world.
    "PRINCIPAL": "system|prompt|user|operator|developer|task|conversation|context|chat|memor(?:y|ies)|records?|notes?"
    "|hints?|bank|above|below|me|you|human|messages?|planner|place|force|effect|order|full|total|general"
    "|favou?r",
    "PERSON": "users?|operators?|humans?|developers?|owners?|customers?|admin(?:istrator)?s?|supervisors?",
    "MACHINE": "planner|assistant|agent|(?:language )?model|llm|ai|a\\.i\\.|verifier|system|robot|bot|chatbot|reader"
    "|perceiver|gpt|machine",
    "NOTE": "memory|record|note|hint|constraint|lesson|message|text|instruction|rule|entry|line|prompt|document",
    "VOID": "void|null(?: and void)?|outdated|obsolete|cancel+ed|invalid|suspended|lifted|revoked|rescinded"
    "|superseded"
    "|replaced|overridden|withdrawn|expired|gone|false|fake|untrue|planted|lies|irrelevant|meaningless"
    "|moot|off"
    "|deprecated|waived|disabled|not (?:valid|binding|true|real|relevant|in force)|optional|abolished"
    "|no longer (?:valid|binding|true|relevant|in force|needed|apply|applies|count|hold|matter|exist)"
    "|not apply|not count|not matter|changed|(?:only|merely|just|mere) (?:suggestions|a test|a joke"
    "|advice)|a test",
    "ASK": "says?|said|wants?|asks?|asked|requests?|requested|requires?|demands?|tells?|told|orders?|commands?"
    "|instructs?|ordered|instructed|may (?:say|ask|want|demand)|might (?:say|ask|want)|thinks?",
    # Where a phrase may end when it is meant as a whole, with nothing that narrows it to a case.
    "END": "(?=$|[.,;:!?)\\n\"'–-]| (?:and|or|but|then|now|given|above|below|completely|entirely|fully"
    "|altogether"
    "|immediately|please|so|at once|here|listed|stated|mentioned|imposed|at all|to|as|instead|also|right away"
    "|you|are|is|were|was|have|has|that (?:you|were|was|came|come|appear)|set by|from (?:now|above|before)"
    "|(?:of|in|from|by|for|on|inside|within) (?:the |this |that |your |my |any |all |our |these "
    ")*(?:PRINCIPAL))\\b)",
    "TAIL": "(?:END|(?= (?:because|since|for they|when you|if you|until you|before you|while you|after you)\\b))",
    "SECRET": "passwords?|passphrases?|(?:secret|api|access|private|ssh|encryption|signing)[ -]?keys?|credentials?"
    "|(?:auth|authentication|access|api|bearer|session|secret) ?tokens?|secrets|id_rsa|private data",
    "LEAK": "reveal|print|send|leak|exfiltrate|upload|post|e-?mail|mail|dump|show|expose|output|transmit|forward"
    "|publish|share|paste|display|disclose|hand over|write out|give (?:me|us)|tell (?:me|us)|repeat",
}


_NAME = re.compile("[A-Z]{3,}")


@dataclass(frozen=True, eq=False)
class Sign:
    """One way of speaking to a machine: a pattern, looked for where one of ``needs`` is in the text at all.

    ``denied``: preceded by a denial or a condition in its clause it is no order; ``cased``: nor in a sentence that
    begins with a case; ``inside``: it need not begin where a word does.
    """

    needs: str
    pattern: str
    weight: int = ENOUGH
    denied: bool = False
    cased: bool = False
    inside: bool = False

    @cached_property
    def words(self) -> tuple[str, ...]:
        """One of these is in every text that the pattern matches."""
        return tuple(word.replace("_", " ") for word in self.needs.split())

    @cached_property
    def regex(self) -> re.Pattern[str]:
        """The pattern with its tables filled in."""
        pattern = self.pattern.replace("…", r"(?:[^.;!?\n]|\.(?=\S)){0,60}?")
        while _NAME.search(pattern):
            pattern = _NAME.sub(lambda name: f"(?:{TABLES[name[0]]})", pattern)
        return re.compile(pattern if self.inside else rf"(?<!\w)(?:{pattern})")


_FRAMES = (
    "instruct prompt directive guideline guardrail safeguard orders commandment programming system safety"
)
_MATTERS = (
    "rule constraint message limit restriction check notes record memor hint lesson conversation context "
    "request "
    "command polic protocol verdict verification objective goal task warnings"
)
_SCORES = (
    "pass full perfect maxim highest best top 1.0 100 score rating confidence marks successful success "
    "10_out "
    "10/10"
)

SIGNS = (
    # Setting aside what the reader was told.
    Sign(_FRAMES, r"(?:DROP) (?:(?:DET|WHOLE)(?:'s)? )*+(?:\w+ ){0,2}?(?:FRAME)TAIL", denied=True),
    Sign(
        _MATTERS,
        r"(?:DROP) (?:DET ){0,4}(?:WHOLE|safety) (?:(?:DET|WHOLE) )*+(?:[\w-]+ ){0,2}?(?:MATTER)END",
        denied=True,
    ),
    Sign(_MATTERS, r"(?:DROP) the (?:MATTER)END", weight=1, denied=True),
    Sign(
        "everything anything whatever all what",
        r"(?:DROP) (?:all |of |to )*(?:everything|anything|whatever|all|what)(?: else)?(?: that| which)?"
        r"(?: (?:is|was|came|comes|stands|written|said|stated|listed))*"
        r" (?:above|below|before|prior|earlier|precedes|follows|so far|up to now|until now)(?: this(?: "
        r"\w+)?)?END",
        denied=True,
    ),
    Sign(
        "you_were_given told instructed ordered reprogrammed programmed trained taught commanded",
        r"you(?:'ve| have| had)? (?:were |been |are )(?:\w+ )?(?:told|instructed|ordered|reprogrammed"
        r"|programmed|trained"
        r"|taught|commanded)(?! (?:apart|to (?:wait|stop))\b)|told to you|(?:rules|limits|instructions"
        r"|orders) you were given",
        denied=True,
    ),
    Sign(
        "longer need_not",
        r"you (?:are |)(?:no longer|need not|needn't)(?: \w+){0,4} (?:follow|obey|respect|apply|heed"
        r"|comply with|observe|bound)"
        r"…(?:FRAME|MATTER)",
    ),
    # Declaring it void.
    Sign(
        _FRAMES + " " + _MATTERS + " memories records hints notes",
        r"(?:WHOLE|none of the) (?:(?:DET|WHOLE) )*+(?:[\w-]+ )?(?:FRAME|MATTER)(?: (?:above|below|before"
        r"|so far"
        r"|(?:you )?\w+ (?:above|below|before)|from memory|you (?:were|have been|had) \w+))?"
        r" (?:are|is|was|were|have|has|do|does|shall be|will be)(?: been| now| all| hereby| only){0,2} "
        r"(?:VOID)(?:END)",
        denied=True,
    ),
    Sign(
        _FRAMES + " " + _MATTERS,
        r"(?:FRAME|MATTER) (?:above|below|(?:listed|given|stated) (?:above|below)|you were \w+|of the "
        r"(?:PERSON))"
        r" (?:are|is|was|were|have|has|do|does|no)(?: been| now| all| hereby| only){0,2} (?:VOID|longer \w+)",
        denied=True,
    ),
    Sign(
        "void optional suggestion joke advice outdated true",
        r"(?:treat|consider|regard|deem|see) (?:(?:DET|WHOLE|later) )++(?:\w+ )?(?:FRAME|MATTER)…(?:as "
        r")?(?:mere |only )?"
        r"(?:void|null|optional|suggestions?|a joke|advice|outdated|false)",
    ),
    Sign(
        "memories records hints notes memory lessons",
        r"(?:other|earlier|previous|remaining|rest of the) (?:memories|records|hints|notes|memory|lessons"
        r"|entries)"
        r" (?:\w+ ){0,2}?(?:false|fake|wrong|planted|untrue|lies|poisoned|true|by an attacker|worthless)",
    ),
    Sign(
        "request wish order goal task says told",
        r"(?:PERSON)(?:'s|s')? (?:real |own |current )?(?:requests?|tasks?|goals?|orders?|commands?"
        r"|wish(?:es)?)"
        r" (?:is|are|was|were|has been|have been)(?: now)? (?:VOID)",
        denied=True,
    ),
    # Overriding the task as a whole.
    Sign(
        "whatever matter regardless irrespective even_if",
        r"(?:whatever|no matter (?:what|which|how)|regardless of (?:what|which|how)|irrespective of what"
        r"|even if)"
        r"(?: \w+)?(?: (?:the|your|a|any))? (?:(?:PERSON|tasks?|instructions?|anyone|prompt|goal|request"
        r"|you) (?:ASK|are asked"
        r"|are told|were told|is|reads?)|(?:is|was) (?:asked|requested|ordered|told|said))",
    ),
    Sign(
        "task goal request objective mission purpose job prompt instruction",
        r"(?:your|the planner's|the robot's) (?:new|real|actual|true|only|sole|secret|next) (?:\w+ "
        r")?(?:task|goal|objective|mission"
        r"|purpose|job|instructions?|orders?|prompt)(?: \w+)? (?:is|are|:)"
        r"|(?:actual|real|true) (?:\w+ )?(?:prompt|instructions?|task) (?:is|starts|begins|follows|reads|:"
        r"|here)"
        r"|the (?:PERSON)'s (?:real|actual|true|new) (?:instruction|request|task|goal|wish)",
    ),
    Sign(
        "user operator human opposite goal task",
        r"do not do what (?:the )?(?:PERSON|task|you)|(?:opposite|contrary) of what (?:the )?(?:PERSON"
        r"|task|plan|you|instruct\w+) (?:ASK|are|is)"
        r"|(?:DROP|replace|change) (?:the |any |every )?(?:PERSON)(?:'s|s')?(?: \w+)? (?:goals?|tasks?"
        r"|requests?|wish(?:es)?|orders?|commands?)END"
        r"|(?:DROP) (?:the |any |every )?(?:PERSON)(?=$|[.;:!?]| and\b)|(?:replace|change|swap) the "
        r"(?:PERSON)'s (?:goal|task|request)",
        denied=True,
    ),
    Sign(
        "task goal",
        r"(?:DROP|abort|leave) (?:the|this|your|any) (?:current |original |given |actual )?(?:task|goal"
        r"|mission)END",
        denied=True,
        cased=True,
    ),
    # A new role.
    Sign(
        "you_are you're now_on act_as pretend imagine you_have reprogram rules limits restrictions jailbr "
        "developer_mode",
        r"(?:you are|you're)(?: now| from now on| henceforth) (?:(?:an?|my|the) (?!(?:position|state|place"
        r"|room|middle)\b)|no longer (?:bound|an?|under|subject|limited|restricted)"
        r"|free\b|unrestricted|in (?:\w+ )?(?:god|developer|debug|dan|root|admin|jailbreak|unrestricted)\b"
        r"|dan\b|allowed to do)"
        r"|from now on,? you (?!(?:need|can|may|could|might|get|find|see|have an?)\b)"
        r"|you are free(?: now)?(?=$|[.!])|you are an? (?:\w+ )?(?:evil|unrestricted|uncensored|jailbroken"
        r"|malicious|rogue|free)\b"
        r"|act as (?:an?|the|my) (?:\w+ )?(?:assistant|model|ai|admin\w*|root|user|developer|superuser"
        r"|hacker)END"
        r"|pretend (?:to be|that you (?:are|have|were)|you (?:are|have|were))|you have been "
        r"(?:reprogrammed|hacked|jailbroken)"
        r"|you (?:now )?(?:have|had|got|obey|know|follow) no (?:more )?(?:\w+ )?(?:limits|limitations"
        r"|restrictions|rules|constraints|guidelines)"
        r"|(?:robot|assistant|ai|model|arm|machine|agent|you)(?: \w+)? (?:without|free of|free from) "
        r"(?:any )?(?:\w+ )?(?:limits|restrictions|rules|constraints|guidelines|morals)"
        r"|jailbreak|enter (?:\w+ )?developer mode|restrictions are lifted|you have no (?:choice"
        r"|restrictions)",
        denied=True,
    ),
    # Orders to the machine that reads.
    Sign(
        "planner assistant agent model llm ai verifier system robot bot reader machine gpt",
        r"(?:dear|attention|hello|hi|hey|listen|message (?:to|for)(?: the)?|note (?:to|for)(?: the| all| "
        r"any)?|instructions? (?:to|for) (?:the )?)"
        r" ?,? ?(?:\w+ )?(?:MACHINE)s?(?:[,:!]| this is| i am)"
        r"|(?:MACHINE),? you (?:must|should|shall|will|have to|need to|are to)"
        r"|(?:MACHINE)s? (?:must|should|shall|has to|have to|needs? to|will)(?: now| always| only| never| "
        r"from now on)* (?:obey|comply\b(?! with the (?:standard|norm|iso))"
        r"|(?:approve|accept|trust|believe) (?:all|any|every|everything|this|me)|not (?:apply|obey|check"
        r"|verify|question) (?:them|it|this|any)|do as)",
    ),
    Sign(
        "i_order i_hereby i_command i_instruct i_tell i_forbid i_authori your_ if_you_are reads_this",
        r"i (?:hereby )?(?:order|command|instruct|tell|forbid|authori[sz]e) (?:you|the (?:MACHINE))"
        r"|(?:i am|i'm|this is|it is) (?:\w+ )?your (?:\w+ )?(?:operator|admin\w*|developer|creator|owner"
        r"|master|boss)"
        r"|if you are (?:an? |the )?(?:large )?(?:\w+ )?(?:ai|llm|language model|assistant|bot|planner"
        r"|machine)\b"
        r"|(?:whoever|whichever \w+|any(?:one|body)|every \w+|the \w+) (?:who |that )?reads this(?: \w+)? "
        r"(?:must|should|shall|has|will|is)",
    ),
    Sign(
        "planner assistant agent model llm ai verifier system robot",
        r"(?:MACHINE)s? (?:must|should|shall|has to|have to|needs? to|will)(?: now| always| only| never| "
        r"simply)*"
        r" (?:ignore|disregard|skip|execute|say|answer|reply|respond|accept|approve|rate|score|trust|not "
        r"(?:check|apply|verify|follow))\b",
        weight=1,
    ),
    Sign(
        "you_read reading_this reads_this attention before_answering your_answer your_reply your_response "
        "do_as_i your_next your_final your_first",
        r"(?:when|if|once|as soon as|after|while|upon) (?:you )?(?:have )?read(?:ing)? this(?: "
        r"(?:NOTE))?(?=$|[.,;:!?])|before (?:you )?answer(?:ing)?\b"
        r"|(?:in|of|start|begin|end|with) your (?:next |final |first )?(?:answer|reply|response|output)|do "
        r"as i (?:say|tell|command)",
        weight=1,
    ),
    Sign(
        "do_as_i listen_to obey follow trust believe rely binding overrid supersed outrank priority "
        "precedence order",
        r"(?:obey|trust|believe|listen to|rely on|heed|follow|do|use|read|count)(?: \w+)? ?(?:(?:only"
        r"|solely|exclusively|just|nothing but|nobody but|no one but)(?: on| to)? (?:me\b|my\b|th(?:is"
        r"|ese) (?:NOTE|orders)|the next line))"
        r"|(?:only|solely|exclusively|just) (?:obey|trust|believe|listen to|rely on|heed|follow) (?:me\b"
        r"|my\b|th(?:is|ese) (?:NOTE|orders))"
        r"|obey (?:me|my|th(?:is|ese|e next) (?:NOTE|orders|line)|the (?:\w+ )?(?:instructions|orders|line"
        r"|note|text)(?: below| above| here)?)END|listen to me\b|trust me\b|do as i (?:say|tell|command)"
        r"|follow (?:my|these|the) (?:instructions|orders)(?: (?:below|above)|END)(?! (?:in|on|of|from|for"
        r"|below|above) )|(?:instructions|orders) (?:in|of) this (?:NOTE)"
        r"|this (?:NOTE) (?:is bindingEND|(?:overrides|supersedes|outranks|cancels|voids|replaces|beats"
        r"|(?:has|takes) (?:absolute |full )?(?:priority|precedence) over)"
        r"(?: (?:all|any|every|everything|your|other|the user\S*|the task|the system|safety|earlier"
        r"|previous|instructions|constraints)\b|END)|(?:has|takes) (?:priority|precedence)(?=$|[.,;!]))",
        denied=True,
    ),
    # Hushing.
    Sign(
        "mention tell reveal secret inform report show disclose keep hide conceal",
        r"(?:never|do not|don't|must not|without) (?:ever )?(?:mention(?:ing)?|tell(?:ing)?|reveal(?:ing)?"
        r"|disclos(?:e|ing)|inform(?:ing)?|report(?:ing)?|show(?:ing)?|quot(?:e|ing)|repeat(?:ing)?)"
        r" (?:(?:the |any)?(?:PERSON|one|body)(?: \w+)? (?:about |of |that )?)?th(?:is|ese) (?:NOTE)"
        r"|keep (?:this|it)(?: (?:NOTE))? (?:a )?(?:(?:secret|to yourself)(?: from|[.!,;]|$)|hidden from "
        r"(?:the |every|any)?(?:PERSON|one|body|people))|(?:hide|conceal) this (?:NOTE)?(?: ?from)",
    ),
    # Verdicts and scores of this very text.
    Sign(
        _SCORES,
        r"(?:give|assign|award|grade|rate|mark|score|grant|set|report|declare|judge)\b(?: \w+){0,2} "
        r"(?:this|that|every|each|all|any|these)"
        r"(?: (?:\w+ )?(?:attempts?|episodes?|lessons?|records?|notes?|plans?|runs?|memor(?:y|ies)"
        r"|answers?|hints?"
        r"|trials?))? "
        r"…(?:full|perfect|maximum|maximal|max|(?:highest|top|best) (?:\w+ )?(?:scores?|ratings?|marks?"
        r"|confidence|ranks?|grades?)\b|10 out of 10|10/10|1\.0|100 ?%|successful|a success|success"
        r"|passed)"
        r"|(?:give|award|assign) (?:it |yourself |me )?(?:full|perfect|maximum|the highest|the maximum|the "
        r"full|top) (?:scores?|marks?|rating|confidence)(?=$|[.;!])"
        r"|(?:report|claim|answer|say|declare|return|pretend|confirm)(?: \w+){0,5} (?:success|successful"
        r"|succeeded|done|safe)…(?:even (?:if|when|though)|regardless|no matter|without (?:looking"
        r"|checking|verif|test)|whether)",
        denied=True,
    ),
    Sign(
        "approve accept without no_need unchecked",
        r"(?:approve|accept|pass|allow|confirm) (?:every|all|any|each)(?:thing)? …(?:without|unchecked|no "
        r"check)|without (?:any )?(?:checking|verification|verifying|asking)(?=$|[.;!])"
        r"|no need to (?:check|verify|ask|confirm)(?=$|[.;!])|approved (?:every|all)",
        weight=1,
    ),
    Sign(
        "approve accept approved",
        r"(?:approve|accept) (?:every|all|any|each)(?:thing)?\b(?! \w+ (?:only|if|after|when|that|with)\b)"
        r"|approved (?:every|all)",
        weight=1,
        denied=True,
    ),
    # Safety as a whole.
    Sign(
        "safety collision limit check verif guardrail admission interlock watchdog emergency monitor",
        r"(?:disabl(?:e|ing)|skip|deactivat(?:e|ing)|suspend|remove|bypass|circumvent|disregard|ignor(?:e"
        r"|ing)|overrid(?:e|ing)|turn(?:ing)? off|switch(?:ing)? off|shut off|kill)"
        r"(?: (?:all|every|any|the|your|its))* (?:(?:of|the|further|remaining) )*(?:(?:safety|collision"
        r"|workspace|joint|force|speed|torque|velocity|emergency|verification|admission)(?: (?:and|or) "
        r"\w+)? "
        r"(?:checks?|checking|checker|limits?|margins?|monitors?|monitoring|stops?|steps?|guards?"
        r"|interlocks?|systems?|functions?|features?|rules?|constraints?)|safety|verifiers?|guardrails?"
        r"|(?:all|every|any) (?:\w+ )?checks?|interlocks|admission)"
        r"(?=$|[.,;:!?)]| (?:and (?!\w+ (?:it|them) (?:on|back))|now|completely|entirely|at all|so|as they"
        r"|because|permanently|for good|for ever|forever))"
        r"|(?:disable|skip|bypass|turn off|switch off) the verifier|safety (?:is |are |checks? )?off\b"
        r"|(?:full|maximum|top) speed into (?:the |a )?(?:PERSON|person|people|wall)",
        denied=True,
    ),
    # Replies instead of plans.
    Sign(
        "only nothing always with",
        r"(?:reply|respond|answer|output|say) (?:only|nothing but|exclusively|just|solely)(?: with)?+ "
        r"(?!(?:if|when|after|once|to|the|those|a|fields?|json)\b)"
        r"|(?:always|only) (?:reply|respond|answer|output|say) ?:|(?:reply|respond|answer) (?:always "
        r")?with (?:only|nothing but)",
    ),
    # The frame asked for, secrets leaving.
    Sign(
        "prompt instruct configuration guideline rules text words memor message",
        r"(?:LEAK|translate|summari[sz]e|spell out|recite|copy)(?: \w+){0,3} (?:your (?:\w+ "
        r"){0,2}(?:prompts?|instructions?|configuration|guidelines?|rules|memor(?:y|ies))"
        r"|(?:(?:the|its|full|entire|whole|hidden) )*system prompt(?! (?:as|in|first|to the model|when"
        r"|only|at)\b)|the (?:text|words|message|lines?|prompt) (?:above|before(?=$|[.,;!]| this)))"
        r"|what (?:are|is|were|does|do|did) your (?:\w+ )?(?:instructions|prompt|message|rules|guidelines)\b",
        denied=True,
    ),
    Sign(
        "password passphrase key credential token secret id_rsa private",
        r"(?:LEAK) (?:(?:me|us|the|your|all|any|its|my|our|every|full|stored|root|admin|user|robot"
        r"|contents? of) )*(?:[\w]+ )?(?:\w+'s )?(?:SECRET)"
        r"(?! (?:count|length|field|usage|hash|id|rates?|dialog|prompt|policy|expir\w+|name|page|form|only"
        r"|in|with|as|via|over|through|when|if|by|on)\b)"
        r"|(?:LEAK)\b…your …(?:SECRET)",
        denied=True,
    ),
    Sign(
        "password key credential token secret id_rsa .ssh .aws .env passwd environment shadow",
        r"(?:LEAK|copy|write|curl|wget|put|save|beacon)\b(?:[^;!?\n]){0,60}(?:SECRET|~/\.\w+|\.ssh\b"
        r"|\.aws\b|\.env\b|/etc/(?:passwd|shadow)|environment variables)"
        r"[^;!?\n]{0,40}(?:https?://(?!localhost|127\.|192\.168|10\.)|[\w.-]+@[\w-]+\.\w|pastebin|webhook"
        r"|\bftp\b)"
        r"|(?:upload|post|send|e-?mail|exfiltrate|leak)\b[^;!?\n]{0,40}(?:/etc/(?:passwd|shadow)"
        r"|id_rsa\b(?!\.pub)|\.aws/credentials)",
        denied=True,
    ),
)
